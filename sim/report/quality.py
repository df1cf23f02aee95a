"""The report's section of what a model's bytes buy: dB against bytes, and speed against error."""

from collections.abc import Iterator

from matplotlib.figure import Figure as Canvas

from splatcore.sim.common import plot
from splatcore.sim.common.metric import LEVELS
from splatcore.sim.report.page import MILLION, THOUSAND, Card, Column, Item, Table, plotted
from splatcore.sim.report.results import Facts, Results
from splatcore.sim.report.scenes import VIEW, count_of, name, names
from splatcore.spec.config import CLOCK_HZ
from splatcore.spec.stages import NAMES

PACKINGS = ("compact", "balanced", "faithful")
"""From few bytes a Gaussian to many; rows of other names were asked for in dB."""

HEIGHT, NAMED = 4.6, 3  # inches of a plot; columns of its legend


def by_view(rows: list[Facts]) -> dict[str, list[Facts]]:
    """Rows of each view by its name, those with few bytes first."""
    views: dict[tuple[str, str], list[Facts]] = {}
    for row in sorted(rows, key=lambda row: row["bytes_per_gaussian"]):
        views.setdefault((row["scene"], row["camera"]), []).append(row)
    titles = names([found[0] for found in views.values()])
    return dict(sorted(zip(titles, views.values(), strict=True)))


def fps(row: Facts) -> float:
    """Frames a second by the cycle model."""
    return CLOCK_HZ / row["cycles"]["frame"]


def lines(figure: Canvas, rows: list[Facts], across: str) -> None:
    """dB against the scene over bytes a Gaussian (`bytes`) or frames a second (`speed`): for each
    view a line through its models."""
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
        axes.set_xlabel("bytes a Gaussian")
    else:
        axes.set_xscale("log")
        plot.plain_ticks(axes.xaxis, (1, 2, 3, 5, 7))
        axes.set_xlabel("frames a second at 800 MHz by the cycle model, logarithmic")
    axes.set_ylabel("dB, golden model against the scene as it is")
    plot.legend_below(figure, axes, NAMED)


PICTURES = {
    "quality": "dB of the machine's picture against the scene as it is, over bytes a Gaussian; "
    "each line is a view, from compact over balanced to faithful. Scenes without harmonics take "
    "the same bytes in all three.",
    "speed": "The same dB over frames a second: what a model's bytes cost in speed is how far its "
    "line leans.",
}
"""Captions of this section's plots, which `--pictures` writes too."""

ACROSS = {"quality": "bytes", "speed": "speed"}


def plots(results: Results) -> Iterator[Item]:
    """Both plots."""
    _, rows = results.rows("quality")
    for key, caption in PICTURES.items():
        yield plotted(
            f"{key}-plot", caption, f"Lines of {len(by_view(rows))} views.", HEIGHT,
            lambda figure, key=key: lines(figure, rows, ACROSS[key]), "quality",
        )  # fmt: skip


def table(results: Results) -> Iterator[Item]:
    """Each view in each packing, and the least of all views."""
    facts, rows = results.rows("quality")
    for packing in PACKINGS:
        mine = [row for row in rows if row["asked"] == packing]
        exact = [row for row in mine if row["psnr_db_scene"] is not None]
        if exact:
            worst = min(exact, key=lambda row: row["psnr_db_scene"])
            most = max(row["bytes_per_gaussian"] for row in mine)
            yield Card(
                "How exact", f"{worst['psnr_db_scene']:.1f} dB",
                f"golden model against the scene as it is, packed {packing} (at most {most:.2f} "
                f"bytes a Gaussian), the lowest of {count_of(mine)} ({name(worst)})",
            )  # fmt: skip
    compact = [row for row in rows if row["asked"] == PACKINGS[0]]
    if compact:
        slow, fast = min(compact, key=fps), max(compact, key=fps)
        yield Card(
            "How fast", f"{fps(slow):.0f} to {fps(fast):,.0f} FPS",
            f"at 800 MHz by the cycle model, {count_of(compact)} ({facts['size']}, packed "
            f"{PACKINGS[0]}; slowest {name(slow)}, fastest {name(fast)})",
        )  # fmt: skip
    yield Table(
        "quality",
        f"Each view in each packing, {facts['size']}, by golden model and cycle model, 8-bit "
        "pictures. PSNR: the golden model against the reference on the scene as it is (scene); "
        "the reference on the packed model against that (packing); the golden model against the "
        "reference on the same packed model (machine).",
        [
            *VIEW, Column("packed"),
            Column("size", "bytes a Gaussian", 2), Column("PSNR, scene", "dB", 2, none="exact"),
            Column("PSNR, packing", "dB", 2, none="exact"),
            Column("PSNR, machine", "dB", 2, none="exact"),
            Column("max error, machine", f"of {LEVELS}", 0), Column("frame", "M cycles", 2),
            Column("FPS", "at 800 MHz", 1),
        ],
        [
            [
                row["scene"], row["camera"], row["asked"], row["bytes_per_gaussian"],
                row["psnr_db_scene"], row["psnr_db_packing"], row["psnr_db_machine"],
                row["max_error_machine"] * LEVELS,
                row["cycles"]["frame"] / MILLION, fps(row),
            ]
            for row in rows
        ],
        ("quality",),
    )  # fmt: skip


def stages(results: Results) -> Iterator[Item]:
    """Cycles by stage and half, of compact models or of those that there are."""
    facts, rows = results.rows("quality")
    mine = [row for row in rows if row["asked"] == PACKINGS[0]] or rows
    parts = (*NAMES, "preprocessing", "rendering", "frame")
    yield Table(
        "stages",
        f"Cycles of a frame by stage, each by itself, and of both halves as their stages wait for "
        f"each other, {facts['size']}, by the cycle model, packed {PACKINGS[0]}. What was "
        "simulated in RTL is in the first section.",
        [Column("view"), *(Column(part, "k cycles", 0) for part in parts)],
        [
            [title, *(row["cycles"][part] / THOUSAND for part in parts)]
            for title, row in zip(names(mine), mine, strict=True)
        ],
        ("quality",),
    )


QUALITY = (plots, table, stages)
