"""The report's section of the ablation: frames a second with each saving added."""

import math
from collections.abc import Iterator

from matplotlib.figure import Figure as Canvas

from splatcore.sim.common.plot import legend_below, plain_ticks, side_by_side
from splatcore.sim.report.page import Card, Column, Item, Table, plotted
from splatcore.sim.report.results import Facts, Results
from splatcore.sim.report.scenes import AGAINST_RTL, VIEW, against_rtl, count_of, names

PAPER = "the paper"

View = tuple[str, str]
"""Scene and camera."""


def by_view(results: Results) -> tuple[Facts, dict[View, dict[str, Facts]]]:
    """The ablation, and for each view its rows by step."""
    facts, rows = results.rows("ablation")
    found: dict[View, dict[str, Facts]] = {}
    for row in rows:
        found.setdefault((row["scene"], row["camera"]), {})[row["step"]] = row
    return facts, found


def gains(values: list[float | None]) -> list[float | None]:
    """The gain of each step over the one before it; None where one of both is missing.

    The paper has no value for a step that is ours only: there the last one before it counts.
    """
    found, before = [], None
    for value in values:
        found.append(value / before if value and before else None)
        before = value or before
    return found


def speeds(results: Results) -> Iterator[Item]:
    """Frames a second and gains by step."""
    facts, found = by_view(results)
    steps = [step["name"] for step in facts["steps"]]
    rows = [[PAPER, "", *(step["paper_fps"] for step in facts["steps"])]]
    for view, by_step in found.items():
        rows.append([*view, *(_fps(by_step.get(step)) for step in steps)])
    yield Table(
        "ablation",
        f"Frames a second at 800 MHz with one saving after the other, {facts['size']}, by the "
        "cycle model. The guard band (Gaussians beside the image are dropped before they are "
        "projected) is ours.",
        [*VIEW, *(Column(step, "FPS", 1) for step in steps)],
        rows, ("ablation",), frozenset({0}),
    )  # fmt: skip
    factors = [[*row[:2], *gains(row[2:])[1:], _whole(row[2:])] for row in rows]
    yield Table(
        "ablation-gains",
        "What each step gains over the one before it. A step can only gain where the half of the "
        "frame that it shortens is the longer one.",
        [*VIEW, *(Column(step, "×", 2) for step in steps[1:]), Column("all together", "×", 2)],
        factors, ("ablation",), frozenset({0}),
    )  # fmt: skip
    whole = [row[-1] for row in factors[1:] if row[-1]]
    if whole:
        mean = math.exp(sum(map(math.log, whole)) / len(whole))
        paper = f"; the paper: {factors[0][-1]:.1f} ×" if factors[0][-1] else ""
        yield Card(
            "What each idea buys", f"{mean:.1f} ×",
            f"frames a second by all savings together, geometric mean of {count_of(whole)}{paper}",
        )  # fmt: skip


def _fps(row: Facts | None) -> float | None:
    return row and row["fps_at_800mhz"]


def _whole(values: list[float | None]) -> float | None:
    """The last over the first."""
    return values[-1] / values[0] if values[0] and values[-1] else None


def bars(results: Results) -> Iterator[Item]:
    """Grouped bars, the paper's first."""
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
        axes.set_xlabel("frames a second at 800 MHz, logarithmic")
        legend_below(figure, axes, 3)

    yield plotted(
        "ablation-bars",
        "Frames a second step by step, the paper's first.",
        f"Grouped bars of {len(labels)} views, one for each of {len(lengths)} steps.",
        1.2 + 0.42 * len(labels), draw, "ablation",
    )  # fmt: skip


def simulated(results: Results) -> Iterator[Item]:
    """Rows that were simulated in RTL."""
    facts, found = by_view(results)
    rows = [
        [*view, step, *against_rtl(row["cycles"]["frame"], row["rtl_cycles"], row["rtl_identical"])]
        for view, by_step in found.items()
        for step, row in by_step.items()
        if row["rtl_cycles"]
    ]
    if rows:
        yield Table(
            "ablation-rtl",
            f"Steps that were built and simulated in RTL, {facts['size']}; identical: whether the "
            "picture is the golden model's, every bit of it.",
            [*VIEW, Column("step"), *AGAINST_RTL], rows, ("ablation",),
        )  # fmt: skip


BLOCKS = (bars, speeds, simulated)
