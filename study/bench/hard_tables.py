"""Terminal output of the hard cases: one line and one table row each."""

from rich.table import Table

from splatcore.sim.common.table import new_table, shown
from splatcore.sim.frame.metric import LEVELS
from splatcore.study.bench.hard_cases import Outcome

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


def table(outcomes: list[Outcome], title: str) -> Table:
    """Table with one row per case."""
    numbers = (
        "dB, machine", "dB, own rule", "SSIM, machine", "max error, machine", "dB, scene",
        "dB, packing", "cycles",
    )  # fmt: skip
    drawn = new_table("case", numbers, title, ("dropped", "bound", ""))
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
    """A PSNR as text. value None: identical pictures if `compared`, else not compared."""
    if value is not None:
        return f"{value:.2f}"
    return "identical" if compared else "–"


def left_out(outcome: Outcome) -> str:
    """Counts of dropped Gaussians by cause, and the count of all Gaussians."""
    parts = [f"{count} {CAUSES[cause]}" for cause, count in outcome.left_out.items() if count]
    return f"{', '.join(parts)} of {outcome.gaussians}" if parts else "–"
