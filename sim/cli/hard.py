"""The command `hard`: every hard case through an engine, and whether it meets its bound."""

from pathlib import Path

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from rich.table import Table

from splatcore.model.generate.hard import HARD
from splatcore.sim.bench.hard_cases import PSNR_MIN, SEED, SHEET, Outcome, camera_of, measure
from splatcore.sim.cli import options
from splatcore.sim.cli.render_rtl import TimingOption
from splatcore.sim.common.metric import LEVELS, channel_error
from splatcore.sim.common.output import console, progress_bar, write_json
from splatcore.sim.common.picture import DOTS_PER_INCH, write_figure, write_png
from splatcore.sim.common.source import ENGINES, check_fits, check_known, parse_size
from splatcore.sim.common.table import new_table, print_whole, shown
from splatcore.sim.machine.path import build
from splatcore.sim.machine.script import LPDDR4, find_timing
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset

SHEET_COLUMNS, INCHES = 4, (3.8, 1.9)
"""Cases side by side, each with its picture and its map of errors; the size of each."""

CAUSES = {
    "not_finite": "NaN or Inf",
    "transparent": "transparent",
    "near_culled": "near",
    "unseen": "unseen",
}
"""Why a Gaussian is left out, in the table's words."""


NameArgument = options.argument(str | None, "NAME", "Which case. Default: all of them.")
OutputOption = options.option(Path | None, "DIR", f"Folder for pictures and {SHEET}.", "-o")


@options.app.command(
    "hard",
    help="Run the hard cases through an engine: small scenes on which renderers go wrong.\n\n"
    "For each of them a picture, its error against the float64 reference on the same packed model "
    "and on the scene as it is, what packing loses, "
    "cycles (golden: the cycle model's, rtl: measured), Gaussians left out, "
    f"and whether it meets its bound: {PSNR_MIN:.0f} dB against the reference under the machine's "
    "own rule for what is too faint to be seen, with harmonics a bound on packing, too, and for "
    "rtl every bit of the golden model's picture. Exit status 1 if one does not (the FP16 "
    "numbers of PAPER do not meet it)."
    "\n\nNAME is one of: " + ", ".join(HARD) + ".",
)
def hard_command(
    name: NameArgument = None,
    engine: options.EngineOption = "golden",
    preset: options.PresetOption = "DEFAULT",
    size: options.SizeOption = None,
    timing: TimingOption = LPDDR4.name,
    output: OutputOption = None,
    json: options.JsonOption = None,
):
    names = [name] if name is not None else list(HARD)
    check_known("hard case", HARD, *names)
    check_known("--engine", ENGINES, engine)
    config, memory = find_preset(preset), find_timing(timing)
    if engine != "rtl" and memory is not LPDDR4:
        raise InputError("--timing: goes with --engine rtl")
    shape = parse_size(size) if size else None
    if engine != "reference":
        for case in names:
            camera = camera_of(HARD[case](SEED), shape)
            check_fits(config, camera.width, camera.height)
    machine = build(config) if engine == "rtl" else None
    outcomes = []
    for number, case in enumerate(names):
        with progress_bar(f"{case} by {engine}", len(names)) as advance:
            advance(number, len(names))
            outcomes.append(measure(case, engine, config, shape, machine, memory))
        console.print(pass_line(outcomes[-1]), soft_wrap=True, markup=False)
    print_whole(table(outcomes, f"{engine}, preset {config.name}"))
    failed = [outcome.name for outcome in outcomes if not outcome.passed]
    console.print(
        f"{len(outcomes) - len(failed)} of {len(outcomes)} pass"
        + (f"; not: {', '.join(failed)}" if failed else ""),
        soft_wrap=True,
    )
    if output:
        write_pictures(output, outcomes, engine)
    write_json(json, {
        "engine": engine, "preset": config.name, "timing": memory.name if machine else None,
        "passed": not failed, "cases": {outcome.name: outcome.facts() for outcome in outcomes},
    })  # fmt: skip
    if failed:
        raise typer.Exit(1)


def pass_line(outcome: Outcome) -> str:
    """A line that says whether a case meets its bound, and all that is wrong with it."""
    if not outcome.passed:
        return f"{outcome.name}: FAIL ({outcome.bound}): {'; '.join(outcome.failures)}"
    found = [outcome.reason or f"{shown(outcome.psnr_db_rule, '.2f', none='∞')} dB"]
    if outcome.identical:
        found.append("identical to the golden model's")
    return f"{outcome.name}: pass ({outcome.bound}): {', '.join(found)}"


def table(outcomes: list[Outcome], title: str) -> Table:
    """A row for each case."""
    numbers = (
        "dB, machine", "dB, own rule", "SSIM, machine", "max error, machine", "dB, scene",
        "dB, packing", "cycles",
    )  # fmt: skip
    drawn = new_table("case", numbers, title, ("left out", "bound", ""))
    for outcome in outcomes:
        error, scene, packing = outcome.error, outcome.scene, outcome.packing
        values = outcome.psnr_db, outcome.psnr_db_rule
        psnrs = (decibels(value, error is not None) for value in values)
        largest = "–" if error is None else f"{round(error.max_error * LEVELS)} of {LEVELS}"
        lost = decibels(packing and packing.psnr_db, packing is not None)
        of_scene = decibels(scene and scene.psnr_db, scene is not None)
        cells = (
            *psnrs,
            shown(error and error.ssim, ".5f"),
            largest,
            of_scene,
            lost,
            shown(outcome.cycles, ",.0f"),
            left_out(outcome),
        )
        drawn.add_row(outcome.name, *cells, outcome.bound, "pass" if outcome.passed else "FAIL")
    return drawn


def decibels(value: float | None, compared: bool) -> str:
    """A PSNR; pictures that were compared and have none are identical."""
    if value is not None:
        return f"{value:.2f}"
    return "identical" if compared else "–"


def left_out(outcome: Outcome) -> str:
    """Counts of Gaussians that are left out, by cause, and of all."""
    parts = [f"{count} {CAUSES[cause]}" for cause, count in outcome.left_out.items() if count]
    return f"{', '.join(parts)} of {outcome.gaussians}" if parts else "–"


def write_pictures(folder: Path, outcomes: list[Outcome], engine: str):
    """A picture of each case that has one, and the contact sheet."""
    folder.mkdir(exist_ok=True)
    drawn = [outcome for outcome in outcomes if outcome.pixels is not None]
    for outcome in drawn:
        write_png(folder / f"{outcome.name}.png", outcome.pixels)
    if drawn:
        write_sheet(folder / SHEET, drawn, engine)
    console.print(str(folder), soft_wrap=True)


def write_sheet(path: Path, outcomes: list[Outcome], engine: str):
    """All pictures, each with the map of its errors on the right, on one scale for all."""
    errors = [channel_error(outcome.pixels, outcome.reference) for outcome in outcomes]
    columns = min(SHEET_COLUMNS, len(outcomes))
    rows = -(-len(outcomes) // columns)
    size = columns * INCHES[0], rows * INCHES[1] + 1
    figure = Figure(size, DOTS_PER_INCH, layout="constrained")
    axes = figure.subplots(rows, 2 * columns, squeeze=False)
    for one in axes.ravel():
        one.set_axis_off()
    norm = PowerNorm(0.5, vmin=0, vmax=max(1, *(int(error.max()) for error in errors)))
    for place, (outcome, error) in enumerate(zip(outcomes, errors, strict=True)):
        row, column = divmod(place, columns)
        left, right = axes[row, 2 * column : 2 * column + 2]
        _show(left, outcome.pixels, outcome.name)
        value = decibels(outcome.psnr_db, outcome.error is not None)
        value = f"{value} dB" if outcome.psnr_db is not None else value.replace("–", "packing")
        image = _show(right, error, f"{value}, {'pass' if outcome.passed else 'FAIL'}", norm)
    against = "of packing" if engine == "reference" else "of the machine"
    label = f"error {against}, levels of {LEVELS}"
    figure.colorbar(image, ax=axes, label=label, orientation="horizontal", shrink=0.5, aspect=50)
    figure.suptitle(f"The hard cases by engine {engine}", fontsize=11)
    write_figure(path, figure)


def _show(axes: Axes, values: np.ndarray, title: str, norm: PowerNorm | None = None):
    """A picture, or errors by a norm's scale; returns what a colour bar is made of."""
    axes.set_title(title, fontsize=8)
    return axes.imshow(values, cmap="inferno", norm=norm, interpolation="nearest")
