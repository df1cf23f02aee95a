"""Output of the hard cases: lines, a table, pictures, and a contact sheet with error maps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure

from splatcore.sim.common.output import console
from splatcore.sim.common.table import NONE, Column, Table, shown
from splatcore.sim.frame.metric import LEVELS, channel_error
from splatcore.sim.frame.picture import DOTS_PER_INCH, write_figure, write_png
from splatcore.study.bench.hard_cases import Outcome
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import HardCase

CAUSES = {"not_finite": "NaN or Inf", "near_culled": "near"}
"""Causes for which a Gaussian is dropped, as printed, if that is not their name."""

SHOWN = (
    "psnr_db_machine psnr_db_rule ssim_machine max_error_machine psnr_db_scene "
    "psnr_db_packing cycles"
)
"""Keys of columns."""

COMPARED = {
    f"psnr_db_{name}": f"max_error_{side}"
    for name, side in (("machine", "machine"), ("rule", "machine"), ("scene", "scene"),
                       ("packing", "packing"))
}  # fmt: skip
"""PSNR → the error of the same comparison: identical pictures have no PSNR."""


def pass_line(outcome: Outcome) -> str:
    """A line: whether a case meets its bound, and its failures."""
    row = outcome.row
    if not outcome.passed:
        return f"{outcome.name}: FAIL ({row['bound']}): {'; '.join(row['failures'])}"
    found = [row["reason"] or f"{shown(row['psnr_db_rule'], '.2f', none='∞')} dB"]
    if row["identical"]:
        found.append("identical to the golden model's")
    return f"{outcome.name}: pass ({row['bound']}): {', '.join(found)}"


def table(outcomes: list[Outcome], title: str) -> Table:
    """Table with one row per case."""
    rows = [
        outcome.row
        | {key: "identical" for key, error in COMPARED.items() if is_identical(outcome, key, error)}
        | {"case": outcome.name, "dropped": left_out(outcome.row)}
        | {"passed": "pass" if outcome.passed else "FAIL"}
        for outcome in outcomes
    ]
    psnr, *others = (replace(each, none=NONE) for each in columns(HardCase, SHOWN))
    first = [Column("case"), psnr.called("PSNR, machine", unit="dB")]
    texts = [Column("dropped"), Column("bound"), Column("", get="passed")]
    return Table.of("hard", title, [*first, *others, *texts], rows)


def is_identical(outcome: Outcome, key: str, error: str) -> bool:
    """Whether a comparison has no PSNR because the pictures are identical."""
    return outcome.row[key] is None and outcome.row[error] is not None


def left_out(row: dict) -> str:
    """Counts of dropped Gaussians by cause, and the count of all Gaussians."""
    parts = [f"{n} {CAUSES.get(cause, cause)}" for cause, n in row["left_out"].items() if n]
    return f"{', '.join(parts)} of {row['gaussians']}" if parts else NONE


SHEET = "hard-cases.png"  # contact sheet in the folder of pictures

SHEET_COLUMNS, INCHES = 4, (3.8, 1.9)
"""Cases per row of the contact sheet, and size of a case: its picture and its error map."""


def write_pictures(folder: Path, outcomes: list[Outcome], engine: str):
    """Write a picture of each case that has one, and the contact sheet."""
    folder.mkdir(exist_ok=True)
    drawn = [outcome for outcome in outcomes if outcome.pixels is not None]
    for outcome in drawn:
        write_png(folder / f"{outcome.name}.png", outcome.pixels)
    if drawn:
        write_sheet(folder / SHEET, drawn, engine)
    console.print(str(folder), soft_wrap=True)


def write_sheet(path: Path, outcomes: list[Outcome], engine: str):
    """Write all pictures, each with its error map on the right, on one common scale."""
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
        none = "packing" if outcome.row["max_error_machine"] is None else "identical"
        psnr = outcome.row["psnr_db_machine"]
        value = none if psnr is None else f"{psnr:.2f} dB"
        image = _show(right, error, f"{value}, {'pass' if outcome.passed else 'FAIL'}", norm)
    against = "of packing" if engine == "reference" else "of the machine"
    label = f"error {against}, of {LEVELS}"
    figure.colorbar(image, ax=axes, label=label, orientation="horizontal", shrink=0.5, aspect=50)
    figure.suptitle(f"The hard cases by engine {engine}", fontsize=11)
    write_figure(path, figure)


def _show(axes: Axes, values: np.ndarray, title: str, norm: PowerNorm | None = None):
    """Show a picture, or errors on the scale of a norm; return the image for a colour bar."""
    axes.set_title(title, fontsize=8)
    return axes.imshow(values, cmap="inferno", norm=norm, interpolation="nearest")
