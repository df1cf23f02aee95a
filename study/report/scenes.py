"""The report's section on real scenes: cycles, error and traffic of frames simulated in RTL."""

from collections.abc import Iterator, Sequence
from functools import partial

from matplotlib.figure import Figure as Canvas

from splatcore.eda.paper import FPS
from splatcore.sim.common.plot import legend_below, mark, side_by_side, stacked
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.error import InputError
from splatcore.study.bench.scenes import MEGABYTE, TRAFFIC
from splatcore.study.report.page import MILLION, Card, Item, plotted
from splatcore.study.report.results import Facts, Results
from splatcore.study.results.campaigns import Simulated
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import HALVES, SceneRow
from splatcore.study.results.known import RESULTS

CYCLES_MAX = CLOCK_HZ / FPS  # per frame at the paper's frame rate

CAUSES = {
    "model": ("read_model", "read_positions", "read_attributes"),
    "features written": ("write_features",),
    "features read": ("read_features",),
    "lists": ("write_lists", "read_lists", "write_groups", "read_groups"),
    "dealing of long lists": ("read_long_lists", "write_buckets"),
    "image": ("write_pixels",),
}
"""Groups of causes of traffic, for the plot."""

BAR, AROUND = 0.27, 1.15  # inches of a plot per bar or pair of bars; for its axis and legend

VIEW = columns(SceneRow, "scene camera")

OFF_BY = Column(
    "model off by", "%", 2, get=lambda row: 100 * (row["model_cycles"] / row["cycles"] - 1)
)

AGAINST_RTL = columns(Simulated, "model_cycles cycles identical")
AGAINST_RTL.insert(2, OFF_BY)


def views(results: Results) -> list[Facts]:
    """All finished views; the others are added to the troubles."""
    rows = results.of_scenes(results.facts("scenes")["rows"])
    for row in rows:
        results.check(row)
        if "cycles" not in row:
            view = f"{row['scene']} {row['camera']}, {row['timing']['name']}"
            results.troubles.append(f"{row.file}: {view}: {row['ended']}")
    done = [row for row in rows if "cycles" in row]
    if not done:
        raise InputError(f"{results.path('scenes').parent}: has no finished view")
    return done


def of_memory(rows: list[Facts]) -> list[Facts]:
    """The views measured with non-ideal memory, or all if there are none."""
    with_memory = [row for row in rows if row["timing"]["name"] != "ideal"]
    return with_memory or rows


def name(row: Facts) -> str:
    """A view's name without file suffixes; just the scene's if the camera has the same name."""
    scene = row["scene"].split(".")[0]
    return scene if row["camera"] in ("", scene) else f"{scene} {row['camera']}"


def count_of(rows: Sequence[object]) -> str:
    """The number of views as text."""
    return f"{len(rows)} view" + "s" * (len(rows) != 1)


def names(rows: Sequence[Facts]) -> list[str]:
    """Names of views, with file suffixes if two views share a name."""
    short = [name(row) for row in rows]
    return [
        f"{row['scene']} {row['camera']}".strip() if short.count(text) > 1 else text
        for row, text in zip(rows, short, strict=True)
    ]


def megabytes(row: Facts, causes: Sequence[str]) -> float:
    """DRAM traffic of a view by some causes."""
    return sum(row["traffic_bytes"].get(cause, 0) for cause in causes) / MEGABYTE


MODEL = Column(
    "model", "off by %", 1,
    get=lambda row: 100 * (row["model_cycles"]["frame"] / row["cycles"]["frame"] - 1),
)  # fmt: skip

CYCLES_SHOWN = "cycles.preprocessing cycles.rendering cycles.frame cycles.fps_at_800mhz"
ERRORS_SHOWN = "psnr_db_machine psnr_db_scene max_error_machine identical"
"""Keys of columns."""

ANY = "in the lowest sufficient quality"


def of_views(rows: list[Facts]) -> tuple[list[Column], str]:
    """Columns that identify a view: scene, camera, and size, memory and packing if they differ.

    Returns the columns, and the common values as a caption.
    """
    texts = (
        Column("size"), Column("memory", get="timing.name"),
        Column("packing", get=lambda row: f"packed {row.get('quality') or ANY}"),
    )  # fmt: skip
    differ = [text for text in texts if len({text.value(row) for row in rows}) > 1]
    alike = [text.value(rows[0]) for text in texts if text not in differ]
    return [*VIEW, *differ], ", ".join(alike)


def left_out(results: Results) -> Iterator[Item]:
    """Add the views that were rendered by the golden model but not simulated to the troubles."""
    rows = views(results)
    try:
        _, others = results.rows("quality")
    except InputError:  # reported in its own section
        return ()
    done = {(row["scene"], row["camera"]) for row in rows}
    first = {(row["scene"], row["camera"]): row for row in others}
    if missing := [row for view, row in first.items() if view not in done]:
        place = results.folder
        results.troubles.append(
            f"not simulated in RTL: {', '.join(names(missing))}; create with: "
            f"make RESULTS={place} {place}/{RESULTS['scenes'].file}"
        )
    return ()


def measured(results: Results) -> Iterator[Item]:
    """Table of cycles and error of each view."""
    rows = views(results)
    view, alike = of_views(rows)
    yield from cards(of_memory(rows))
    yield Table.of(
        "scenes",
        f"Frames in RTL simulation ({alike}). Both halves work at the same time on neighbouring "
        "frames, so a frame takes as long as the slower half. Model: deviation of the cycle "
        "model's frame. PSNR and largest error per channel: 8-bit pictures against the float64 "
        "reference on the same packed model (machine) and on the scene as trained, all harmonics "
        "(scene; – if only a packed model was given). Identical: every bit of the picture equals "
        "the golden model's.",
        [*view, *columns(SceneRow, CYCLES_SHOWN), MODEL,
         *columns(SceneRow, ERRORS_SHOWN), TRAFFIC],
        rows,
    )  # fmt: skip


def cards(rows: list[Facts]) -> Iterator[Card]:
    """Cards of the slowest view and the worst pictures."""
    slowest = max(rows, key=lambda row: row["cycles"]["frame"])
    of = f"of {count_of(rows)} in RTL simulation"
    yield Card(
        "How fast", f"{slowest['cycles']['fps_at_800mhz']:.0f} FPS",
        f"at 800 MHz, the slowest {of} ({name(slowest)}, {slowest['size']}); the paper: {FPS} on "
        "average",
    )  # fmt: skip
    same = sum(row["identical"] for row in rows)
    yield Card(
        "How exact", f"{same} of {len(rows)}",
        "views in RTL simulation equal the golden model in every bit",
    )  # fmt: skip
    for key, truth in {
        "psnr_db_machine": "the float64 reference on the same packed model",
        "psnr_db_scene": "the float64 reference on the scene as trained, all harmonics",
    }.items():
        inexact = [row for row in rows if row.get(key) is not None]
        if inexact:
            worst = min(inexact, key=lambda row: row[key])
            about = f"against {truth}, the lowest {of} ({name(worst)})"
            yield Card("How exact", f"{worst[key]:.1f} dB", about)


def bars(results: Results) -> Iterator[Item]:
    """Bars of the cycles of both halves, with the paper's frame rate."""
    rows = of_memory(views(results))

    def draw(figure: Canvas):
        axes = figure.subplots()
        halves = {half: [row["cycles"][half] / MILLION for row in rows] for half in HALVES[:2]}
        side_by_side(axes, names(rows), halves)
        mark(
            axes,
            CYCLES_MAX / MILLION,
            f"the paper's {FPS} frames per second: {CYCLES_MAX / 1e6:.1f}",
        )
        axes.set_xlabel("millions of cycles per frame")
        axes.set_xlim(0, 1.08 * max(CYCLES_MAX / MILLION, *(max(v) for v in halves.values())))
        legend_below(figure, axes, 2)

    yield plotted(
        "cycles",
        "Cycles per frame of both halves (one bar each, see the legend) by view; the longer bar "
        "sets the frame rate. Dashed line: cycles per frame at 800 MHz and the paper's frame rate, "
        "which is an average over its own scenes.",
        f"Bars of {len(rows)} views, with the paper's frame rate as a line.",
        AROUND + BAR * len(rows), draw,
    )  # fmt: skip


def traffic(results: Results) -> Iterator[Item]:
    """DRAM traffic by cause: plot and table."""
    rows = of_memory(views(results))
    view, alike = of_views(rows)
    causes = list(dict.fromkeys(cause for row in rows for cause in row["traffic_bytes"]))
    known = {cause for together in CAUSES.values() for cause in together}
    groups = [
        Column(name, "MB", 2, get=partial(megabytes, causes=together))
        for name, together in (CAUSES | {c: (c,) for c in causes if c not in known}).items()
    ]
    amounts = {group.name: [group.value(row) for row in rows] for group in groups}

    def draw(figure: Canvas):
        axes = figure.subplots()
        stacked(axes, names(rows), amounts)
        axes.set_xlabel("DRAM traffic per frame, MB")
        legend_below(figure, axes, 3)

    yield plotted(
        "traffic-by-cause",
        "DRAM traffic per frame by cause (colours of the legend), in whole beats. Dealing: lists "
        "that are too long to be sorted on chip are written to memory in buckets first.",
        f"Stacked bars of {len(rows)} views.",
        AROUND + 0.2 + BAR * len(rows), draw,
    )  # fmt: skip
    yield Table.of(
        "traffic",
        f"The same in numbers, from the performance counters ({alike}).",
        [*view, *groups, TRAFFIC.called("all", digits=2)], rows,
    )  # fmt: skip


BLOCKS = (left_out, measured, bars, traffic)
