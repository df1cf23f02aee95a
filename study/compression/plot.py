"""Plots of `splatcore bench compression`: curves of PSNR against size and speed; contact sheets."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from splatcore.golden.reference import render
from splatcore.model.formats.photographs import Target
from splatcore.sim.common.plot import COLOURS, GREY, MARKERS, STYLE
from splatcore.sim.frame.metric import flip_map
from splatcore.sim.frame.picture import write_figure
from splatcore.study.compression.measure import Version
from splatcore.study.compression.subjects import Subject

DOTS_PER_INCH = 120

AGAINST = {
    "photographs": ("psnr_db_change", "PSNR change on held-out photographs, dB", 51.6, -0.75),
    "original": ("psnr_db", "PSNR against the original, dB", 20, 30.0),
}
"""By kind of truth: key of the value to plot, axis label, and the goal (minimum ratio and dB)."""


ratio_of = itemgetter("ratio")

ACROSS: dict[str, Callable[[dict], float]] = {
    "compression ratio to the float32 PLY (cross: packing alone)": ratio_of,
    "bytes per Gaussian of the original scene": lambda point: point["bytes_each"],
    "frames per second at 800 MHz, by the cycle model": lambda point: point["work"][
        "fps_at_800mhz"
    ],
}
"""Labels of the x axes, and the value of a point on each; the goal is on the first."""


def write_curve(path: Path, scenes: dict[str, dict]):
    """Plot PSNR of all scenes over each x axis, one row per kind of truth; nothing without points.

    Lines connect points in order of ratio. A cross is packing alone; grey lines mark the goal.
    """
    rows = {
        against: {
            name: sorted(filter(ratio_of, scene["curve"]["points"]), key=ratio_of)
            for name, scene in scenes.items()
            if "curve" in scene and scene["against"] == against
        }
        for against in AGAINST
    }
    rows = {against: found for against, found in rows.items() if found}
    if not rows:
        return
    with figure_at(path, 5.6 * len(ACROSS), 4.4 * len(rows)) as figure:
        places = figure.subplots(len(rows), len(ACROSS), squeeze=False)
        for panels, (against, found) in zip(places, rows.items(), strict=True):
            for axes, label in zip(panels, ACROSS, strict=True):
                _panel(axes, against, found, label)
            _mark(panels[0], against)


@contextmanager
def figure_at(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Yield a figure (width and height in inches) to draw on; write it to `path` as PNG."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((width, height), DOTS_PER_INCH, layout="constrained")
        yield figure
        write_figure(path, figure, facecolor="white")


def _panel(axes: Axes, against: str, scenes: dict[str, list[dict]], across: str):
    """Draw the curves of scenes with the same kind of truth."""
    value, label, _, _ = AGAINST[against]
    of = ACROSS[across]
    for k, (name, points) in enumerate(scenes.items()):
        drawn = [(of(p), p[value]) for p in points if p[value] is not None]
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        axes.plot(*zip(*drawn, strict=True), color=colour, marker=marker, label=name)
        alone = [(of(p), p[value]) for p in points if p["target_ratio"] is None]
        axes.plot(*zip(*alone, strict=True), "x", color=colour, markersize=10)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda tick, _: f"{tick:g}"))
    axes.set_xlabel(across)
    axes.set_ylabel(label)
    axes.legend(loc="best")


def _mark(axes: Axes, against: str):
    """Draw the goal as two grey lines."""
    _, _, ratio, least = AGAINST[against]
    axes.axhline(least, color=GREY, linestyle="--")
    axes.axvline(ratio, color=GREY, linestyle="--")
    axes.annotate(
        f"{ratio:g}× and {least:g} dB".replace("-", "−"), (ratio, least), (5, 5),
        textcoords="offset points", color=GREY,
    )  # fmt: skip


def write_sheet(path: Path, subject: Subject, view: Target, version: Version, row: dict):
    """Write truth, compressed model and their FLIP map side by side. row: of `version`."""
    truth = subject.truth(view)
    picture = render(version.gaussians, view.camera).pixels
    psnr = "equal" if row["psnr_db"] is None else f"{row['psnr_db']:.2f} dB"
    titles = {
        "photograph" if subject.photographed else "original": truth,
        f"{version.name}: {row['ratio']:.1f}×, {psnr} over all views": picture,
        "FLIP error map (dark: equal)": flip_map(picture, truth),
    }
    height, width = truth.shape[:2]
    with figure_at(path, 18, 6 * height / width + 0.5) as figure:
        for axes, (title, image) in zip(figure.subplots(1, 3), titles.items(), strict=True):
            axes.imshow(image, cmap="magma", vmin=0, vmax=1)
            axes.set_title(title, fontsize=12)
            axes.set_axis_off()
        figure.suptitle(f"{subject.name}, view {view.name}", fontsize=12)
