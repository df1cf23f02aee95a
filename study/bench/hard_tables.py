"""Terminal output of the hard cases: one line and one table row each."""

from dataclasses import replace

from splatcore.sim.common.table import NONE, Column, Table, shown
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
