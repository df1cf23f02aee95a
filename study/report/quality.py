"""The report's section on image quality against model size and speed."""

from collections.abc import Iterator

from matplotlib.figure import Figure as Canvas

from splatcore.sim.common import plot
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import CLOCK_HZ
from splatcore.study.report.page import THOUSAND, Card, Item, plotted
from splatcore.study.report.results import Facts, Results
from splatcore.study.report.scenes import count_of, name, names
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import CYCLES, PACKINGS, QualityRow

SHOWN = (
    "scene camera asked bytes_per_gaussian psnr_db_scene psnr_db_packing psnr_db_machine "
    "max_error_machine cycles.frame"
)
PARTS = " ".join(f"cycles.{part}" for part in CYCLES)
"""Keys of columns."""

HEIGHT, NAMED = 4.6, 3  # of a plot, inches; columns of its legend


def by_view(rows: list[Facts]) -> dict[str, list[Facts]]:
    """Rows by name of the view, by rising bytes."""
    views: dict[tuple[str, str], list[Facts]] = {}
    for row in sorted(rows, key=lambda row: row["bytes_per_gaussian"]):
        views.setdefault((row["scene"], row["camera"]), []).append(row)
    titles = names([found[0] for found in views.values()])
    return dict(sorted(zip(titles, views.values(), strict=True)))


def fps(row: Facts) -> float:
    """Frames per second by the cycle model."""
    return CLOCK_HZ / row["cycles"]["frame"]


def lines(figure: Canvas, rows: list[Facts], across: str) -> None:
    """Draw PSNR against the scene as trained, one line per view through its models.

    across: the x axis, "bytes" (per Gaussian) or "speed" (frames per second)
    """
    axes = figure.subplots()
    for number, (title, found) in enumerate(by_view(rows).items()):
        shown = [row for row in found if row["psnr_db_scene"] is not None]
        over = [row["bytes_per_gaussian"] if across == "bytes" else fps(row) for row in shown]
        axes.plot(
            over, [row["psnr_db_scene"] for row in shown], label=title,
            color=plot.COLOURS[number % len(plot.COLOURS)],
            marker=plot.MARKERS[number % len(plot.MARKERS)],
            linestyle=plot.DASHES[number // len(plot.COLOURS) % len(plot.DASHES)],
        )  # fmt: skip
    if across == "bytes":
        axes.set_xlabel("bytes per Gaussian")
    else:
        axes.set_xscale("log")
        plot.plain_ticks(axes.xaxis, (1, 2, 3, 5, 7))
        axes.set_xlabel("frames per second at 800 MHz by the cycle model, logarithmic")
    axes.set_ylabel("PSNR against the scene as trained, dB")
    plot.legend_below(figure, axes, NAMED)


PICTURES = {
    "quality": "PSNR of the machine's 8-bit picture against the float64 reference on the scene as "
    "trained (y axis; higher is better) over the model's size (x axis). Each line is one view, "
    "with the colour and marker of the legend; its points are packed models, from compact via "
    "balanced to faithful. Scenes without harmonics have the same size in all three.",
    "speed": "The same PSNR over frames per second (x axis, logarithmic). The more a line leans to "
    "the left, the more speed its larger models cost.",
}
"""Captions of this section's plots, by file name of `--pictures`."""

ACROSS = {"quality": "bytes", "speed": "speed"}


def plots(results: Results) -> Iterator[Item]:
    """Both plots."""
    _, rows = results.rows("quality")
    for key, caption in PICTURES.items():
        yield plotted(
            f"{key}-plot", caption, f"Lines of {len(by_view(rows))} views.", HEIGHT,
            lambda figure, key=key: lines(figure, rows, ACROSS[key]),
        )  # fmt: skip


def table(results: Results) -> Iterator[Item]:
    """Table of all views and packings, and cards with the lowest values."""
    facts, rows = results.rows("quality")
    for packing in PACKINGS:
        mine = [row for row in rows if row["asked"] == packing]
        exact = [row for row in mine if row["psnr_db_scene"] is not None]
        if exact:
            worst = min(exact, key=lambda row: row["psnr_db_scene"])
            most = max(row["bytes_per_gaussian"] for row in mine)
            yield Card(
                "How exact", f"{worst['psnr_db_scene']:.1f} dB",
                f"golden model against the scene as trained, packed {packing} (at most {most:.2f} "
                f"bytes per Gaussian), the lowest of {count_of(mine)} ({name(worst)})",
            )  # fmt: skip
    compact = [row for row in rows if row["asked"] == PACKINGS[0]]
    if compact:
        slow, fast = min(compact, key=fps), max(compact, key=fps)
        yield Card(
            "How fast", f"{fps(slow):.0f} to {fps(fast):,.0f} FPS",
            f"at 800 MHz by the cycle model, {count_of(compact)} ({facts['size']}, packed "
            f"{PACKINGS[0]}; slowest {name(slow)}, fastest {name(fast)})",
        )  # fmt: skip
    yield Table.of(
        "quality",
        f"Each view in each packing, {facts['size']}, by golden model and cycle model. PSNR "
        "between 8-bit pictures: the golden model against the reference on the scene as trained "
        "(scene); the reference on the packed model against the reference on the scene as trained "
        "(packing); the golden model against the reference on the same packed model (machine).",
        [*columns(QualityRow, SHOWN), Column("FPS", "at 800 MHz", 1, get=fps)], rows,
    )  # fmt: skip


def stages(results: Results) -> Iterator[Item]:
    """Table of cycles by stage and half, for compact models if there are any."""
    facts, rows = results.rows("quality")
    mine = [row for row in rows if row["asked"] == PACKINGS[0]] or rows
    titles = dict(zip(map(id, mine), names(mine), strict=True))
    cycles = (column.called(column.name, unit="k cycles", digits=0, per=THOUSAND)
              for column in columns(QualityRow, PARTS))  # fmt: skip
    yield Table.of(
        "stages",
        f"Cycles per frame by the cycle model: of each stage alone, and of both halves with their "
        f"stages waiting for each other, {facts['size']}, packed {PACKINGS[0]}. The first section "
        "has cycles of RTL simulation.",
        [Column("view", get=lambda row: titles[id(row)]), *cycles], mine,
    )  # fmt: skip


QUALITY = (plots, table, stages)
