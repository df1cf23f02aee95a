"""Plots of `sim.accuracy.points`: pictures by scene, errors by field, both by machine."""

from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from splatcore.sim.common.plot import MARKERS
from splatcore.sim.frame.picture import write_figure
from splatcore.spec.config import Config
from splatcore.study.accuracy.points import heading

INCHES = (15.5, 7.2)
DOTS_PER_INCH = 150

THIN = (":", "--", "-.")  # lines of hard cases, in turn
HOLLOW = {"markersize": 4, "markerfacecolor": "none", "markeredgewidth": 0.8}

WIDTH = 0.8  # of a field's place, shared by the machines' points

LOW = "$\\downarrow$"  # marker of a value below the plot's floor

FLOOR = 1e-10
"""Smallest error that is drawn to scale: smaller ones come from float64, not from a format."""


def write_error_plot(
    path: str | Path,
    results: dict[str, dict],
    largest: dict[str, dict],
    machines: tuple[Config, ...],
):
    """Plot PSNR of each scene's picture (left) and largest RMS of each field (right)."""
    figure = Figure(INCHES, DOTS_PER_INCH, layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_pictures(left, results, machines)
    draw_fields(right, largest, machines)
    figure.suptitle("Stages 0 and 1 against the float64 reference on the same packed models")
    write_figure(path, figure)


def _draw_pictures(axes: Axes, results: dict[str, dict], machines: tuple[Config, ...]):
    """Draw one line per scene over the machines, hard cases thin; exact pictures have no point."""
    places = range(len(machines))
    scenes = hard = 0
    for name, facts in results.items():
        values = [facts["machines"][config.name]["psnr_db_machine"] for config in machines]
        values = [float("nan") if value is None else value for value in values]
        if facts["hard"]:
            style = {"linewidth": 0.8, "marker": ".", "zorder": 1}
            style["linestyle"] = THIN[hard // 10 % 3]
            colour = f"C{hard % 10}"
            hard += 1
        else:
            style = {"linewidth": 1.8, "marker": MARKERS[scenes % len(MARKERS)], "zorder": 2}
            colour = f"C{scenes % 10}"
            scenes += 1
        axes.plot(places, values, color=colour, label=name, **style)
    axes.set_xticks(places, list(map(heading, machines)))
    axes.set_xlabel("machine: exponent/fraction bits of stages 0 and 1")
    axes.set_ylabel("PSNR of the picture against the same packed model, dB")
    axes.set_title("Pictures" + ("; hard cases thin" if hard and scenes else ""))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)


def draw_fields(axes: Axes, largest: dict[str, dict], machines: tuple[Config, ...]):
    """Draw errors by field, the machines side by side: scenes filled, hard cases hollow.

    Errors below `FLOOR` are arrows on it; an exact field has no point.
    """
    fields = list(next(iter(next(iter(largest.values())).values())))
    both, count, low = len(largest) > 1, len(machines) * len(largest), False
    for place, (config, (kind, values)) in enumerate(product(machines, largest.items())):
        rms = [values[config.name][field]["rms"] for field in fields]
        rms = np.array([value or np.nan for value in rms])
        number, thin = machines.index(config), both and kind == "hard"
        label = None if thin else heading(config).replace("\n", " ")
        style = HOLLOW if thin else {"markersize": 6, "label": label}
        across = np.arange(len(fields)) + WIDTH * ((place + 0.5) / count - 0.5)
        colour, marker = f"C{number % 10}", MARKERS[number % len(MARKERS)]
        below = rms < FLOOR
        points = {"color": colour, "linestyle": "none"}
        axes.plot(across[~below], rms[~below], marker=marker, **points, **style)
        if below.any():
            at = np.full(below.sum(), FLOOR)
            axes.plot(across[below], at, marker=LOW, **points, **HOLLOW)
            low = True
    names = [field.replace("_", " ") for field in fields]
    axes.set_xticks(range(len(fields)), names, rotation=40, ha="right")
    axes.set_yscale("log")
    axes.set_ylabel("RMS error: u and v in pixels, colour of full scale, others relative")
    axes.set_title(
        "Fields, largest RMS of all scenes"
        + ("; hard cases hollow" if both else "")
        + (f"; arrows: below {FLOOR:.0e}" if low else "")
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
