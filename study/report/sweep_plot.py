"""Plots of the sweep's points: scatter plots of two quantities, and dot plots by knob."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from splatcore.sim.common import plot
from splatcore.study.report.page import MILLION, THOUSAND
from splatcore.study.report.page import Figure as Item
from splatcore.study.report.results import Facts

STEPS = (1, 1.5, 2, 3, 4, 5, 6, 8)  # ticks of a logarithmic axis, times powers of ten

LABELS = {
    "cycles": "million cycles per frame, slowest scene",
    "gates": "thousands of NAND2-equivalents",
    "psnr": "mean PSNR (machine), dB",
    "fps": "frames per second at 800 MHz, slowest scene",
}

PLANE_HEIGHT, ROW, BETWEEN = 3.7, 0.17, 0.36
"""Inches: height of a scatter plot; per value in the plots of knobs; between two knobs."""


def values(points: Facts, quantity: str) -> dict[str, float]:
    """A quantity of each point that has it."""
    key, unit = {
        "cycles": ("frame_cycles_max", MILLION), "gates": ("nand2", THOUSAND),
        "fps": ("fps_min", 1), "psnr": ("psnr_db_machine_mean", 1),
        "lowest": ("psnr_db_machine_min", 1),
    }[quantity]  # fmt: skip
    found = {name: point.get(key) for name, point in points.items()}
    return {name: value / unit for name, value in found.items() if value is not None}


def beaten_by_none(places: dict[str, tuple[float, float]]) -> list[str]:
    """The Pareto front in order of the first number, which is better if lower; the second is better
    if higher."""
    found = []
    for name in sorted(places, key=lambda name: (places[name][0], -places[name][1])):
        if not found or places[name][1] > places[found[-1]][1]:
            found.append(name)
    return found


def scatter(axes: Axes, points: Facts, across: str, up: str) -> dict[str, tuple[float, float]]:
    """Draw the points by knob, filled on the overall front, and this plane's front as steps.

    Returns the places of the points to be named.
    """
    x, y = values(points, across), values(points, up)
    places = {name: (x[name], y[name]) for name in points if name in x and name in y}
    for number, knob in enumerate(dict.fromkeys(point["knob"] for point in points.values())):
        label, colour = knob, plot.COLOURS[number % len(plot.COLOURS)]
        for front in (True, False):
            found = [
                places[name] for name in places
                if points[name]["knob"] == knob and points[name]["front"] == front
            ]  # fmt: skip
            if found:
                axes.plot(
                    *zip(*found, strict=True), label=label, color=colour, linestyle="", zorder=3,
                    marker=plot.MARKERS[number % len(plot.MARKERS)],
                    markerfacecolor=colour if front else "white",
                )  # fmt: skip
                label = None
    steps = [places[name] for name in beaten_by_none(places)]
    line = {"color": plot.GREY, "linestyle": ":", "drawstyle": "steps-post", "zorder": 1}
    axes.plot([place[0] for place in steps], [place[1] for place in steps], **line)
    named = [name for name in places if points[name]["front"] or points[name]["knob"] == "preset"]
    return {name: places[name] for name in named}


def whiskers(axes: Axes, points: Facts, across: str):
    """Draw lines from the mean PSNR down to the lowest."""
    x, mean, lowest = (values(points, quantity) for quantity in (across, "psnr", "lowest"))
    for name in x:
        if name in mean and name in lowest:
            axes.plot([x[name]] * 2, [lowest[name], mean[name]], color=plot.GREY, lw=0.9, zorder=2)


def plane(key: str, caption: str, points: Facts, across: str, up: str, **lines: float) -> Item:
    """Scatter plot of one quantity over another. lines: values at which to draw dashed lines."""

    def draw(figure: Figure):
        axes = figure.subplots()
        axes.set_xscale("log")
        plot.plain_ticks(axes.xaxis, STEPS)
        if up != "psnr":
            axes.set_yscale("log")
            plot.plain_ticks(axes.yaxis, STEPS)
        if across == "gates" and up == "psnr":
            whiskers(axes, points, across)
        named = scatter(axes, points, across, up)
        for quantity, value in lines.items():
            style = {"color": plot.INK, "linestyle": "--", "linewidth": 0.9, "zorder": 1}
            (axes.axvline if quantity == across else axes.axhline)(value, **style)
        axes.margins(0.1)
        axes.set_xlabel(LABELS[across])
        axes.set_ylabel(LABELS[up])
        plot.legend_below(figure, axes, 4)
        plot.name_points(figure, axes, named)

    about = f"Scatter plot of {len(points)} machines."
    return Item(key, caption, about, plot.plot(key, PLANE_HEIGHT, draw))


def knobs(key: str, points: Facts) -> str:
    """A row of three dot plots for each knob, with lines at DEFAULT's values; returns SVG."""
    groups: dict[str, list[str]] = {}
    for name, point in points.items():
        groups.setdefault(point["knob"], []).append(name)
    heights = [len(names) * ROW + BETWEEN for names in groups.values()]

    def draw(figure: Figure):
        grid = figure.subplots(
            len(groups), 3, sharex="col", squeeze=False, gridspec_kw={"height_ratios": heights}
        )
        columns = ("cycles", "psnr", "gates")
        for row, (knob, names) in zip(grid, groups.items(), strict=True):
            for axes, quantity in zip(row, columns, strict=True):
                dots(axes, points, names, quantity)
            row[0].set_yticks(range(len(names)), [str(points[name]["value"]) for name in names])
            for axes in row[1:]:
                axes.set_yticks(range(len(names)), [""] * len(names))
            row[0].set_title(knob, loc="left", fontweight="bold", fontsize=8.5)
        for axes, label in zip(
            grid[-1], ("M cycles per frame", "PSNR (machine), dB", "k NAND2"), strict=True
        ):
            axes.set_xlabel(label)

    return plot.plot(key, sum(heights) + 0.4, draw)


def dots(axes: Axes, points: Facts, names: list[str], quantity: str):
    """Draw a quantity of some points, one row each."""
    found, lowest = values(points, quantity), values(points, "lowest")
    for place, name in enumerate(names):
        if name not in found:
            continue
        if quantity == "psnr" and name in lowest:
            axes.plot([lowest[name], found[name]], [place] * 2, color=plot.GREY, linewidth=1)
        axes.plot(found[name], place, "o", color=plot.COLOURS[0])
    if "DEFAULT" in found:
        axes.axvline(found["DEFAULT"], color=plot.INK, linestyle="--", linewidth=0.8, zorder=1)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.margins(x=0.1)
