"""Plots of one style, as SVG for an HTML page.

Markers, dashes and hatches repeat what colours show. Equal data give equal bytes.
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
"""Okabe and Ito's palette, safe for colour blindness; two colours darker, two more at the end."""

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
"""Text is drawn as outlines, so it looks the same everywhere, also in print."""


ROOM = 3.5  # points kept free around a marker

PLACES = [(7, 0), (-7, 0)] + [
    (right * far, up * far)
    for far in (5, 14, 24, 36)
    for right, up in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1.5), (0, -1.5))
]
"""Candidate offsets of a name from its point, in points."""

FAR = 1.2  # cost of one point of distance, in square points hidden
LEADER = 16  # distance in points from which a leader line is drawn


def plot(key: str, height: float, draw: Callable[[Figure], None]) -> str:
    """Return an SVG element for an HTML page.

    key: unique name within the page
    height: in inches
    draw: draws on the figure
    """
    with matplotlib.rc_context(STYLE | {"svg.hashsalt": key}):
        figure = Figure((WIDTH, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        buffer = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(buffer, format="svg", metadata=nothing, transparent=True)
    return inline(buffer.getvalue(), key)


def inline(text: str, key: str) -> str:
    """Return the element of an SVG file for HTML: without namespaces, IDs prefixed by `key`."""
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
    """Draw horizontal bars, one per label, each stacked from several values."""
    ends = [0.0] * len(labels)
    for number, (name, parts) in enumerate(values.items()):
        axes.barh(
            labels, parts, left=ends, label=name, color=colours[number % len(colours)],
            hatch=HATCHES[number % len(HATCHES)], edgecolor="white", linewidth=0.5, height=0.7,
        )  # fmt: skip
        ends = [end + part for end, part in zip(ends, parts, strict=True)]
    first_on_top(axes)


def side_by_side(axes: Axes, labels: Sequence[str], values: dict[str, Sequence[float]]):
    """Draw horizontal bars, per label one for each name; NaN: no bar."""
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
    """Order bars as in a table, with grid lines for the values only."""
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def plain_ticks(axis: Axis, steps: Sequence[float]):
    """Label a logarithmic axis with few plain numbers instead of powers of ten."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:,g}")
    axis.set_minor_locator(NullLocator())


def mark(axes: Axes, value: float, text: str, dash: str = "--"):
    """Draw a line across bars at a value, with a label above it."""
    axes.axvline(value, color=INK, linestyle=dash, linewidth=1)
    axes.annotate(
        text, (value, 1), xycoords=("data", "axes fraction"), xytext=(0, 3),
        textcoords="offset points", ha="center", va="bottom", fontsize=8,
    )  # fmt: skip


def name_points(figure: Figure, axes: Axes, points: dict[str, tuple[float, float]]):
    """Place names next to points so that they hide neither points nor each other, if possible.

    Call it last: it avoids everything drawn before.
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
    """Move a name by an offset in points, and anchor it on the side towards its point."""
    text.set_position((right, up))
    text.set_ha("left" if right > 0 else "right" if right < 0 else "center")
    text.set_va("bottom" if up > 0 else "top" if up < 0 else "center")


def overlap(one: Bbox, other: Bbox) -> float:
    """Return the area that two boxes share."""
    shared = Bbox.intersection(one, other)
    return shared.width * shared.height if shared else 0.0


def legend_below(figure: Figure, axes: Axes, columns: int):
    """Draw the legend below the plot."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
