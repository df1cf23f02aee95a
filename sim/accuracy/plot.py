"""Plots of `sim.accuracy.points`: pictures by scene, errors by field, both by machine."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from splatcore.sim.accuracy.points import heading
from splatcore.sim.common.picture import write_figure
from splatcore.sim.common.plot import MARKERS
from splatcore.spec.config import Config

INCHES = (15.5, 7.2)
DOTS_PER_INCH = 150

THIN = (":", "--", "-.")  # lines of hard cases, in turn
DOTTED = {"markersize": 4, "markerfacecolor": "none", "linewidth": 0.8, "linestyle": ":"}


def write_error_plot(
    path: str | Path,
    results: dict[str, dict],
    largest: dict[str, dict],
    machines: tuple[Config, ...],
):
    """PSNR of each scene's picture (left) and largest RMS of each field (right, logarithmic)."""
    figure = Figure(INCHES, DOTS_PER_INCH, layout="constrained")
    left, right = figure.subplots(1, 2)
    _draw_pictures(left, results, machines)
    _draw_fields(right, largest, machines)
    figure.suptitle("Stages 0 and 1 against the float64 reference on the same packed models")
    write_figure(path, figure)


def _draw_pictures(axes: Axes, results: dict[str, dict], machines: tuple[Config, ...]):
    """A line for each scene over the machines, hard cases thin; exact pictures have no point."""
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
    axes.set_ylabel("PSNR of the picture, machine, dB")
    axes.set_title("Pictures" + ("; hard cases thin" if hard and scenes else ""))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)


def _draw_fields(axes: Axes, largest: dict[str, dict], machines: tuple[Config, ...]):
    """A line for each machine over the fields: scenes solid, hard cases thin and dotted."""
    fields = list(next(iter(next(iter(largest.values())).values())))
    both = len(largest) > 1
    for number, config in enumerate(machines):
        for kind, values in largest.items():
            rms = [values[config.name][field]["rms"] for field in fields]
            rms = [value or float("nan") for value in rms]  # none, or no error at all: no point
            thin = both and kind == "hard"
            solid = {"markersize": 6, "linewidth": 1.8, "label": heading(config).replace("\n", " ")}
            style = DOTTED if thin else solid
            marker = MARKERS[number % len(MARKERS)]
            axes.plot(rms, color=f"C{number % 10}", marker=marker, **style)
    names = [field.replace("_", " ") for field in fields]
    axes.set_xticks(range(len(fields)), names, rotation=40, ha="right")
    axes.set_yscale("log")
    axes.set_ylabel("RMS error: pixels for u and v, full scale for colour, else relative")
    axes.set_title("Fields, largest RMS" + ("; hard cases thin, dotted" if both else ""))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
