"""Tables of `splatcore compress`: trials and steps."""

from rich.table import Table

from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.sim.common.table import new_table, shown


def trials_of(choice: dict) -> Table:
    """Table of the trial models, one row each, with their values before fine-tuning."""
    table = new_table("trial", ("quality", "Gaussians", "bytes", "PSNR, dB", "FPS"))
    for number, trial in enumerate(choice["trials"]):
        chosen = ", chosen" if number == choice["chosen"] else ""
        table.add_row(
            f"degree {trial['degree']}{chosen}", trial["quality"], f"{trial['gaussians']:,}",
            f"{trial['bytes']:,}", shown(trial["psnr_db"], ".2f"),
            shown(trial["fps"], ".0f"),
        )  # fmt: skip
    return table


def table_of(checkpoints: Checkpoints, original: int) -> Table:
    """Table of the steps, one row each. original: bytes of the original, for the ratio."""
    headings = ("Gaussians", "SH degree", "bytes", "ratio", "loss", "seconds")
    table = new_table("step", headings)
    for step in checkpoints.steps:
        table.add_row(
            step.name, f"{step.gaussians:,}", str(step.sh_degree), f"{step.bytes:,}",
            f"{original / step.bytes:.1f}", shown(step.loss, ".5f"), f"{step.seconds:.0f}",
        )  # fmt: skip
    return table
