"""The report's section of the ablation: what each saving gains."""

import math
from collections.abc import Iterator

from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullLocator

from splatcore.sim.common.plot import COLOURS, HATCHES, first_on_top, legend_below, plot
from splatcore.sim.report.page import Card, Column, Figure, Item, Table
from splatcore.sim.report.results import Facts, Results
from splatcore.sim.report.scenes import MILLION, count_of, names
from splatcore.spec.error import InputError

PAPER = "the paper"

View = tuple[str, str]
"""Scene and camera."""


def steps_and_rows(results: Results) -> tuple[Facts, dict[View, dict[str, Facts]]]:
    """The ablation, and for each view its rows by step; what failed in it is a trouble."""
    facts = results.facts("ablation")
    for failed in facts["failed"]:
        results.troubles.append(f"{facts.file}: {failed['what']}: {failed['why']}")
    found: dict[View, dict[str, Facts]] = {}
    for row in results.of_scenes(facts["rows"]):
        found.setdefault((row["scene"], row["camera"]), {})[row["step"]] = row
    if not found:
        raise InputError(f"{facts.file}: holds no row")
    return facts, found


def gains(values: list[float | None]) -> list[float | None]:
    """What each step gains over the one before it; None where one of both is missing.

    The paper has no value for a step that is ours only: there the last one before it counts.
    """
    found, before = [], None
    for value in values:
        found.append(value / before if value and before else None)
        before = value or before
    return found


def speeds(results: Results) -> Iterator[Item]:
    """Frames a second and gains by step."""
    facts, found = steps_and_rows(results)
    steps = [step["name"] for step in facts["steps"]]
    rows = [[PAPER, "", *(step["paper_fps"] for step in facts["steps"])]]
    for (scene, camera), by_step in found.items():
        rows.append([scene, camera, *(_fps(by_step.get(step)) for step in steps)])
    view = (Column("scene"), Column("camera"))
    yield Table(
        "ablation",
        f"Frames a second at 800 MHz with one saving after the other, {facts['size']}, by the "
        "cycle model. The guard band (Gaussians beside the image are dropped before they are "
        "projected) is ours.",
        [*view, *(Column(step, "FPS", 1) for step in steps)],
        rows, ("ablation",), frozenset({0}),
    )  # fmt: skip
    factors = [[*row[:2], *gains(row[2:])[1:], _whole(row[2:])] for row in rows]
    yield Table(
        "ablation-gains",
        "What each step gains over the one before it. A step can only gain where the half of the "
        "frame that it shortens is the longer one.",
        [*view, *(Column(step, "×", 2) for step in steps[1:]), Column("all together", "×", 2)],
        factors, ("ablation",), frozenset({0}),
    )  # fmt: skip
    whole = [row[-1] for row in factors[1:] if row[-1]]
    if whole:
        mean = math.exp(sum(map(math.log, whole)) / len(whole))
        paper = f"; the paper: {factors[0][-1]:.1f} ×" if factors[0][-1] else ""
        yield Card(
            "What each idea buys", f"{mean:.1f} ×",
            f"frames a second by all savings together, geometric mean of "
            f"{count_of(whole)}{paper}", "ablation",
        )  # fmt: skip


def _fps(row: Facts | None) -> float | None:
    return row and row["fps_at_800mhz"]


def _whole(values: list[float | None]) -> float | None:
    """The last over the first."""
    return values[-1] / values[0] if values[0] and values[-1] else None


def bars(results: Results) -> Iterator[Item]:
    """Grouped bars, the paper's first."""
    facts, found = steps_and_rows(results)
    steps = [step["name"] for step in facts["steps"]]
    labels = [PAPER, *names([next(iter(by_step.values())) for by_step in found.values()])]

    def draw(figure: Canvas):
        axes = figure.subplots()
        width = 0.82 / len(steps)
        for number, step in enumerate(facts["steps"]):
            lengths = [step["paper_fps"], *(_fps(row.get(step["name"])) for row in found.values())]
            places = [n - 0.41 + width * (number + 0.5) for n in range(len(labels))]
            axes.barh(
                places, [length or math.nan for length in lengths], width, label=step["name"],
                color=COLOURS[number % len(COLOURS)], hatch=HATCHES[number % len(HATCHES)],
                edgecolor="white", linewidth=0.4,
            )  # fmt: skip
        axes.set_yticks(range(len(labels)), labels)
        axes.set_ylim(-0.6, len(labels) - 0.4)
        first_on_top(axes)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:,g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlabel("frames a second at 800 MHz, logarithmic")
        legend_below(figure, axes, 3)

    yield Figure(
        "ablation-bars",
        "Frames a second step by step, the paper's first.",
        f"Grouped bars of {len(labels)} views, one for each of {len(steps)} steps.",
        plot("ablation-bars", 1.2 + 0.42 * len(labels), draw),
        sources=("ablation",),
    )


def simulated(results: Results) -> Iterator[Item]:
    """Rows that were simulated in RTL."""
    facts, found = steps_and_rows(results)
    rows = [
        [
            row["scene"], row["camera"], row["step"], row["cycles"]["frame"] / MILLION,
            row["rtl_cycles"] / MILLION, 100 * (row["cycles"]["frame"] / row["rtl_cycles"] - 1),
            row["rtl_identical"],
        ]
        for by_step in found.values()
        for row in by_step.values()
        if row["rtl_cycles"]
    ]  # fmt: skip
    if rows:
        yield Table(
            "ablation-rtl",
            f"Steps that were built and simulated in RTL, {facts['size']}; identical: whether the "
            "picture is the golden model's, every bit of it.",
            [
                Column("scene"), Column("camera"), Column("step"),
                Column("cycle model", "M cycles", 3), Column("RTL", "M cycles", 3),
                Column("model off by", "%", 2), Column("identical"),
            ],
            rows, ("ablation",),
        )  # fmt: skip


BLOCKS = (bars, speeds, simulated)
