"""Terminal output of the hard cases: one line and one table row each."""

from dataclasses import replace

from splatcore.sim.common.table import NONE, Column, Table, shown
from splatcore.study.bench.hard_cases import Outcome
from splatcore.study.results.fields import columns
from splatcore.study.results.frames import HardCase

CAUSES = {
    "not_finite": "NaN or Inf",
    "transparent": "transparent",
    "near_culled": "near",
    "unseen": "unseen",
}
"""Causes for which a Gaussian is dropped, as printed."""


def pass_line(outcome: Outcome) -> str:
    """A line: whether a case meets its bound, and its failures."""
    if not outcome.passed:
        return f"{outcome.name}: FAIL ({outcome.bound}): {'; '.join(outcome.failures)}"
    found = [outcome.reason or f"{shown(outcome.psnr_db_rule, '.2f', none='∞')} dB"]
    if outcome.identical:
        found.append("identical to the golden model's")
    return f"{outcome.name}: pass ({outcome.bound}): {', '.join(found)}"


SHOWN = (
    "psnr_db_machine psnr_db_rule ssim_machine max_error_machine psnr_db_scene "
    "psnr_db_packing cycles"
)
"""Keys of columns."""

COMPARED = {"psnr_db_machine": "error", "psnr_db_rule": "error", "psnr_db_scene": "scene",
            "psnr_db_packing": "packing"}  # fmt: skip
"""PSNR → the comparison that it belongs to: identical pictures have no PSNR."""


def table(outcomes: list[Outcome], title: str) -> Table:
    """Table with one row per case."""
    rows = []
    for outcome in outcomes:
        row = {"case": outcome.name, "dropped": left_out(outcome)} | outcome.facts()
        row["passed"] = "pass" if outcome.passed else "FAIL"
        for key, side in COMPARED.items():
            if row[key] is None and getattr(outcome, side) is not None:
                row[key] = "identical"
        rows.append(row)
    psnr, *others = (replace(each, none=NONE) for each in columns(HardCase, SHOWN))
    shown = [Column("case"), psnr.called("PSNR, machine", unit="dB"), *others]
    texts = [Column("dropped"), Column("bound"), Column("", get="passed")]
    return Table.of("hard", title, [*shown, *texts], rows)


def decibels(value: float | None, compared: bool) -> str:
    """A PSNR as text. value None: identical pictures if `compared`, else not compared."""
    if value is not None:
        return f"{value:.2f}"
    return "identical" if compared else "–"


def left_out(outcome: Outcome) -> str:
    """Counts of dropped Gaussians by cause, and the count of all Gaussians."""
    parts = [f"{count} {CAUSES[cause]}" for cause, count in outcome.left_out.items() if count]
    return f"{', '.join(parts)} of {outcome.gaussians}" if parts else "–"
