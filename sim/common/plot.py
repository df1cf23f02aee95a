"""Plots of one style, as SVG within an HTML page.

Nothing is told by colour alone: markers, dashes and hatches tell the same. Equal data make equal
bytes.
"""

import io
import math
import re
from collections.abc import Callable, Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import LogLocator, NullLocator
from matplotlib.transforms import Bbox

WIDTH = 7.2  # inches of a plot: printable on A4 and on Letter

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#56b4e9", "#5f5f5f", "#7a4ea3")
"""Okabe and Ito's, told apart by all kinds of eyes; two of them darker, two more at the end."""

MARKERS = "osD^vP*X<>hp"

HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "++++", "oo", "--")

DASHES = ("-", "--", "-.", ":")

INK, GREY, GRID = "#1f2933", "#66727f", "#d9dee3"

STYLE = {
    "font.family": "sans-serif", "font.size": 8.5, "axes.titlesize": 9, "axes.labelsize": 8.5,
    "xtick.labelsize": 8, "ytick.labelsize": 8, "legend.fontsize": 8, "text.color": INK,
    "axes.edgecolor": GREY, "axes.labelcolor": INK, "xtick.color": GREY, "ytick.color": GREY,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.linewidth": 0.7, "axes.grid": True,
    "grid.color": GRID, "grid.linewidth": 0.6, "axes.axisbelow": True, "axes.spines.top": False,
    "axes.spines.right": False, "legend.frameon": False, "hatch.linewidth": 0.6,
    "lines.linewidth": 1.2, "lines.markersize": 5, "svg.fonttype": "path",
}  # fmt: skip
"""Text becomes outlines: it looks the same everywhere, in print too."""


ROOM = 3.5  # points around a marker that a name keeps free

PLACES = [(7, 0), (-7, 0)] + [
    (right * far, up * far)
    for far in (5, 14, 24, 36)
    for right, up in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1.5), (0, -1.5))
]
"""Offsets of a name from its place, in points. FAR: square points of hidden things that weigh as
much as a point of distance; LEADER: the distance from which a line leads to it."""

FAR, LEADER = 1.2, 16


def plot(key: str, height: float, draw: Callable[[Figure], None]) -> str:
    """An SVG element for an HTML page, drawn by `draw` on a figure of so many inches."""
    with matplotlib.rc_context(STYLE | {"svg.hashsalt": key}):
        figure = Figure((WIDTH, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        buffer = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(buffer, format="svg", metadata=nothing, transparent=True)
    return inline(buffer.getvalue(), key)


def inline(text: str, key: str) -> str:
    """An SVG file's element for HTML: without name spaces, `key` before its names."""
    text = text[text.index("<svg") :]
    text = re.sub(r'\s+xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'\bid="', f'id="{key}-', text)
    text = re.sub(r'href="#', f'href="#{key}-', text)
    text = text.replace("url(#", f"url(#{key}-")
    return text.replace("<svg", '<svg aria-hidden="true"', 1)


def stacked(
    axes: Axes,
    labels: Sequence[str],
    values: dict[str, Sequence[float]],
    colours: Sequence[str] = COLOURS,
):
    """Bars from the left, one below another, each in parts that add up."""
    ends = [0.0] * len(labels)
    for number, (name, parts) in enumerate(values.items()):
        axes.barh(
            labels, parts, left=ends, label=name, color=colours[number % len(colours)],
            hatch=HATCHES[number % len(HATCHES)], edgecolor="white", linewidth=0.5, height=0.7,
        )  # fmt: skip
        ends = [end + part for end, part in zip(ends, parts, strict=True)]
    first_on_top(axes)


def side_by_side(axes: Axes, labels: Sequence[str], values: dict[str, Sequence[float]]):
    """Bars from the left, for each label one for each name; NaN for none."""
    width = 0.8 / len(values)
    for number, (name, lengths) in enumerate(values.items()):
        places = [n - 0.4 + width * (number + 0.5) for n in range(len(labels))]
        axes.barh(
            places, lengths, width, label=name, color=COLOURS[number % len(COLOURS)],
            hatch=HATCHES[number % len(HATCHES)], edgecolor="white", linewidth=0.5,
        )  # fmt: skip
    axes.set_yticks(range(len(labels)), labels)
    first_on_top(axes)


def first_on_top(axes: Axes):
    """Bars in the order of a table; lines only along the numbers."""
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def plain_ticks(axis: Axis, steps: Sequence[float]):
    """Few numbers on a logarithmic axis, as they are and not as powers of ten."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:,g}")
    axis.set_minor_locator(NullLocator())


def mark(axes: Axes, value: float, text: str, dash: str = "--"):
    """A line across bars at a value, with its meaning above it."""
    axes.axvline(value, color=INK, linestyle=dash, linewidth=1)
    axes.annotate(
        text, (value, 1), xycoords=("data", "axes fraction"), xytext=(0, 3),
        textcoords="offset points", ha="center", va="bottom", fontsize=8,
    )  # fmt: skip


def name_points(figure: Figure, axes: Axes, points: dict[str, tuple[float, float]]):
    """Names beside points, where they hide neither points nor each other as far as there is room.

    Call it when all else is drawn: names must know where things have come to lie.
    """
    figure.draw_without_rendering()
    taken = [
        Bbox.from_bounds(x - ROOM, y - ROOM, 2 * ROOM, 2 * ROOM)
        for line in axes.get_lines()
        if line.get_marker() not in ("", "None", None)
        for x, y in axes.transData.transform(line.get_xydata())
    ]
    inside = axes.get_window_extent()
    for name, place in sorted(points.items(), key=lambda item: item[1]):
        text = axes.annotate(name, place, xytext=(0, 0), textcoords="offset points", fontsize=8)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.6})
        best, least = PLACES[0], math.inf
        for right, up in PLACES:
            put(text, right, up)
            box = text.get_window_extent()
            hidden = sum(overlap(box, other) for other in taken)
            outside = box.width * box.height - overlap(box, inside)
            worse = hidden + 3 * outside + FAR * math.hypot(right, up)
            if worse < least:
                best, least = (right, up), worse
        put(text, *best)
        taken.append(text.get_window_extent())
        if math.hypot(*best) > LEADER:
            axes.annotate(
                "", place, xytext=best, textcoords="offset points",
                arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.5, "shrinkB": 3},
            )  # fmt: skip


def put(text: Annotation, right: float, up: float):
    """Move a name to so many points from its place; what is nearest to the place stays there."""
    text.set_position((right, up))
    text.set_ha("left" if right > 0 else "right" if right < 0 else "center")
    text.set_va("bottom" if up > 0 else "top" if up < 0 else "center")


def overlap(one: Bbox, other: Bbox) -> float:
    """Area that two boxes share."""
    shared = Bbox.intersection(one, other)
    return shared.width * shared.height if shared else 0.0


def legend_below(figure: Figure, axes: Axes, columns: int):
    """The legend, under the plot."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
