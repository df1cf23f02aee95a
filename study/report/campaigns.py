"""The report's sections on the ablation (frames per second as savings are added) and on the work
per frame: culling, early termination, density of tiles."""

import math
from collections.abc import Iterator

from matplotlib.figure import Figure as Canvas

from splatcore.sim.common.plot import legend_below, plain_ticks, side_by_side
from splatcore.sim.common.table import Column, Table
from splatcore.study.report.page import Card, Item, plotted
from splatcore.study.report.results import Facts, Results
from splatcore.study.report.scenes import AGAINST_RTL, VIEW, count_of, names

PAPER = "the paper"

View = tuple[str, str]  # scene and camera


def by_view(results: Results) -> tuple[Facts, dict[View, dict[str, Facts]]]:
    """The ablation, and its rows by view and step."""
    facts, rows = results.rows("ablation")
    found: dict[View, dict[str, Facts]] = {}
    for row in rows:
        found.setdefault((row["scene"], row["camera"]), {})[row["step"]] = row
    return facts, found


def gains(values: list[float | None]) -> list[float | None]:
    """The gain of each step over the step before; None if either value is missing.

    The paper has no value for steps of our own: these are skipped in its row.
    """
    found, before = [], None
    for value in values:
        found.append(value / before if value and before else None)
        before = value or before
    return found


def speeds(results: Results) -> Iterator[Item]:
    """Frames per second and gains by step."""
    facts, found = by_view(results)
    steps = [step["name"] for step in facts["steps"]]
    rows = [[PAPER, "", *(step["paper_fps"] for step in facts["steps"])]]
    rows += [[*view, *(_fps(row.get(step)) for step in steps)] for view, row in found.items()]
    yield Table(
        "ablation",
        f"Frames per second at 800 MHz as savings are switched on from left to right, "
        f"{facts['size']}, by the cycle model. The guard band (Gaussians outside the image are "
        "dropped before projection) is a step of our own.",
        [*VIEW, *(Column(step, "FPS", 1) for step in steps)],
        rows, frozenset({0}),
    )  # fmt: skip
    factors = [[*row[:2], *gains(row[2:])[1:], *gains([row[2], row[-1]])[1:]] for row in rows]
    yield Table(
        "ablation-gains",
        "Gain in frames per second of each step over the step before. A step gains only if it "
        "shortens the slower half of the frame.",
        [*VIEW, *(Column(step, "×", 2) for step in steps[1:]), Column("all together", "×", 2)],
        factors, frozenset({0}),
    )  # fmt: skip
    whole = [row[-1] for row in factors[1:] if row[-1]]
    if whole:
        mean = math.exp(sum(map(math.log, whole)) / len(whole))
        paper = f"; the paper: {factors[0][-1]:.1f} ×" if factors[0][-1] else ""
        yield Card(
            "Gain of each idea", f"{mean:.1f} ×",
            f"frames per second with all savings, geometric mean of {count_of(whole)}{paper}",
        )  # fmt: skip


def _fps(row: Facts | None) -> float | None:
    return row and row["fps_at_800mhz"]


def bars(results: Results) -> Iterator[Item]:
    """Grouped bars of frames per second, the paper's first."""
    facts, found = by_view(results)
    labels = [PAPER, *names([next(iter(by_step.values())) for by_step in found.values()])]
    lengths = {
        step["name"]: [
            fps or math.nan
            for fps in (step["paper_fps"], *(_fps(row.get(step["name"])) for row in found.values()))
        ]
        for step in facts["steps"]
    }

    def draw(figure: Canvas):
        axes = figure.subplots()
        side_by_side(axes, labels, lengths)
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.set_xscale("log")
        plain_ticks(axes.xaxis, (1, 2, 5))
        axes.set_xlabel("frames per second at 800 MHz, logarithmic")
        legend_below(figure, axes, 3)

    yield plotted(
        "ablation-bars",
        "Frames per second (x axis, logarithmic) by view, the paper's own first; one bar per step, "
        "in the colours of the legend, each with all savings of the bars above it.",
        f"Grouped bars of {len(labels)} views, one for each of {len(lengths)} steps.",
        1.2 + 0.42 * len(labels), draw,
    )  # fmt: skip


def simulated(results: Results) -> Iterator[Item]:
    """Steps that were simulated in RTL."""
    facts, found = by_view(results)
    rows = [
        row | {"model_cycles": row["cycles"]["frame"], "cycles": row["rtl_cycles"],
               "identical": row["rtl_identical"]}
        for by_step in found.values()
        for row in by_step.values()
        if row["rtl_cycles"]
    ]  # fmt: skip
    if rows:
        yield Table.of(
            "ablation-rtl",
            f"Steps simulated in RTL, {facts['size']}: cycles per frame by the cycle model and in "
            "RTL. Identical: every bit of the picture equals the golden model's.",
            [*VIEW, Column("step"), *AGAINST_RTL], rows,
        )  # fmt: skip


ABLATION = (bars, speeds, simulated)
