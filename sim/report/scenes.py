"""The report's section of real scenes: cycles, error and traffic of frames simulated in RTL."""

from collections.abc import Callable, Iterator, Sequence

from matplotlib.figure import Figure as Canvas

from splatcore.sim.bench.scenes import MEGABYTE
from splatcore.sim.common.metric import LEVELS
from splatcore.sim.common.paper import FPS
from splatcore.sim.common.plot import legend_below, mark, plot, side_by_side, stacked
from splatcore.sim.report.page import Card, Column, Figure, Item, Table
from splatcore.sim.report.results import Facts, Results
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.error import InputError

MILLION = 1e6

CYCLES_MAX = CLOCK_HZ / FPS
"""Of a frame at the paper's frame rate."""

CAUSES = {
    "model": ("read_model", "read_positions", "read_attributes"),
    "features written": ("write_features",),
    "features read": ("read_features",),
    "lists": ("write_lists", "read_lists", "write_groups", "read_groups"),
    "runs of long lists": ("write_scratch", "read_scratch"),
    "image": ("write_pixels",),
}
"""Causes of traffic, taken together for the plot."""

BAR = 0.27
"""Inches of a plot for each bar or pair of bars; AROUND: for its axis and legend."""

AROUND = 1.15


def views(results: Results) -> list[Facts]:
    """All views that came to their end, those with the slower memory if there are two."""
    rows = list(results.of_scenes(results.several("scenes", "*.json")))
    for row in rows:
        results.check(row)
        if "cycles" not in row:
            what = f"{row['scene']} {row['camera']}, {row['timing']['name']}"
            results.troubles.append(f"{row.file}: {what}: {row['ended']}")
    done = [row for row in rows if "cycles" in row]
    if not done:
        raise InputError(f"{results.path('scenes').parent}: holds no finished view")
    return done


def of_memory(rows: list[Facts]) -> list[Facts]:
    """Each view once: with a memory that has latency, if it was measured so."""
    with_memory = [row for row in rows if row["timing"]["name"] != "ideal"]
    return with_memory or rows


def name(row: Facts) -> str:
    """A view's name without its file's suffixes; a generated scene's own camera has its name."""
    scene = row["scene"].split(".")[0]
    return scene if row["camera"] in ("", scene) else f"{scene} {row['camera']}"


def count_of(rows: Sequence[object]) -> str:
    """How many views there are, in words."""
    return f"{len(rows)} view" + "s" * (len(rows) != 1)


def names(rows: Sequence[Facts]) -> list[str]:
    """Names of views; with the file's suffix where two scenes share a name."""
    short = [name(row) for row in rows]
    return [
        f"{row['scene']} {row['camera']}".strip() if short.count(text) > 1 else text
        for row, text in zip(rows, short, strict=True)
    ]


def of_views(rows: list[Facts]) -> tuple[list[Column], Callable[[Facts], list]]:
    """Columns that say which view a row is, if not all rows say the same; and their cells."""
    said = {
        "scene": lambda row: row["scene"],
        "camera": lambda row: row["camera"],
        "size": lambda row: row["size"],
        "memory": lambda row: row["timing"]["name"],
    }
    names = [
        name for name, say in said.items()
        if name in ALWAYS or len({say(row) for row in rows}) > 1
    ]  # fmt: skip
    return [Column(name) for name in names], lambda row: [said[name](row) for name in names]


def common(rows: list[Facts]) -> str:
    """What all rows say of size and memory alike, for a caption."""
    sizes = {row["size"] for row in rows}
    memories = {row["timing"]["name"] for row in rows}
    alike = [*sizes] * (len(sizes) == 1) + [*memories] * (len(memories) == 1)
    return ", ".join(alike)


ALWAYS = ("scene", "camera")


HALVES = (
    Column("preprocessing", "M cycles", 2), Column("rendering", "M cycles", 2),
    Column("frame", "M cycles", 2),
)  # fmt: skip


def cycles(row: Facts) -> list[float]:
    """Cells of `HALVES`."""
    return [row["cycles"][half] / MILLION for half in ("preprocessing", "rendering", "frame")]


def measured(results: Results) -> Iterator[Item]:
    """Cycles and error of each view."""
    rows = views(results)
    columns, view = of_views(rows)
    yield from cards(of_memory(rows))
    yield Table(
        "scenes",
        f"Frames in RTL simulation ({common(rows)}). A frame takes what the slower half takes, as "
        "both are at work at once on neighbouring frames. Model: the cycle model's frame against "
        "this one. PSNR and largest error of a channel are those of the 8-bit picture against the "
        "float64 reference; identical: whether it is the golden model's, every bit of it.",
        [
            *columns, *HALVES, Column("FPS", "at 800 MHz", 1),
            Column("model", "off by %", 1), Column("PSNR", "dB", 2, none="exact"),
            Column("max error", f"of {LEVELS}", 0), Column("identical"),
            Column("traffic", "MB", 1),
        ],
        [
            [
                *view(row), *cycles(row),
                row["cycles"]["fps_at_800mhz"],
                100 * (row["model_cycles"]["frame"] / row["cycles"]["frame"] - 1),
                row["psnr_db"], row["max_error"] * LEVELS, row["identical"],
                sum(row["traffic_bytes"].values()) / MEGABYTE,
            ]
            for row in rows
        ],
        ("scenes",),
    )  # fmt: skip


def cards(rows: list[Facts]) -> Iterator[Card]:
    """The slowest view and the worst picture."""
    slowest = max(rows, key=lambda row: row["cycles"]["frame"])
    of = f"of {count_of(rows)} in RTL simulation"
    yield Card(
        "How fast", f"{slowest['cycles']['fps_at_800mhz']:.0f} FPS",
        f"at 800 MHz, the slowest {of} ({name(slowest)}, {slowest['size']}); the paper: {FPS} on "
        "average", "scenes",
    )  # fmt: skip
    same = sum(row["identical"] for row in rows)
    yield Card(
        "How exact", f"{same} of {len(rows)}",
        "views in RTL simulation equal the golden model's, every pixel of them", "scenes",
    )  # fmt: skip
    inexact = [row for row in rows if row["psnr_db"] is not None]
    if inexact:
        worst = min(inexact, key=lambda row: row["psnr_db"])
        yield Card(
            "How exact", f"{worst['psnr_db']:.1f} dB",
            f"against float64, the lowest {of} ({name(worst)})", "scenes",
        )  # fmt: skip


def bars(results: Results) -> Iterator[Item]:
    """Cycles of both halves against the bound."""
    rows = of_memory(views(results))

    def draw(figure: Canvas):
        axes = figure.subplots()
        halves = {
            half: [row["cycles"][half] / MILLION for row in rows]
            for half in ("preprocessing", "rendering")
        }
        side_by_side(axes, names(rows), halves)
        mark(
            axes, CYCLES_MAX / MILLION, f"the paper's {FPS} frames a second: {CYCLES_MAX / 1e6:.1f}"
        )
        axes.set_xlabel("millions of cycles of a frame")
        axes.set_xlim(0, 1.08 * max(CYCLES_MAX / MILLION, *(max(v) for v in halves.values())))
        legend_below(figure, axes, 2)

    yield Figure(
        "cycles",
        "Cycles of both halves of a frame; the longer one sets the frame rate. The dashed line is "
        "what 800 MHz leave for a frame at the paper's rate, which is an average over its own "
        "scenes.",
        f"Bars of {len(rows)} views, with the paper's frame rate as a line.",
        plot("cycles", AROUND + BAR * len(rows), draw),
        sources=("scenes",),
    )


def traffic(results: Results) -> Iterator[Item]:
    """Bytes by cause."""
    rows = of_memory(views(results))
    columns, view = of_views(rows)
    causes = list(dict.fromkeys(cause for row in rows for cause in row["traffic_bytes"]))
    known = {cause for together in CAUSES.values() for cause in together}
    groups = CAUSES | {cause: (cause,) for cause in causes if cause not in known}
    amounts = {
        group: [
            sum(row["traffic_bytes"].get(cause, 0) for cause in together) / MEGABYTE for row in rows
        ]
        for group, together in groups.items()
    }

    def draw(figure: Canvas):
        axes = figure.subplots()
        stacked(axes, names(rows), amounts)
        axes.set_xlabel("MB of DRAM traffic of a frame")
        legend_below(figure, axes, 3)

    yield Figure(
        "traffic-by-cause",
        "DRAM traffic of a frame by cause, in whole beats. Runs of long lists are sorted runs that "
        "did not fit on chip.",
        f"Stacked bars of {len(rows)} views.",
        plot("traffic-by-cause", AROUND + 0.2 + BAR * len(rows), draw),
        sources=("scenes",),
    )
    yield Table(
        "traffic",
        f"The same in numbers, as the performance counters have them ({common(rows)}).",
        [*columns, *(Column(group, "MB", 2) for group in groups), Column("all", "MB", 2)],
        [
            view(row)
            + [amounts[group][n] for group in groups]
            + [sum(row["traffic_bytes"].values()) / MEGABYTE]
            for n, row in enumerate(rows)
        ],
        ("scenes",),
    )


BLOCKS = (measured, bars, traffic)
