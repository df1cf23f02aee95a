"""Tables of `splatcore compress`: what was tried, and the steps."""

from rich.table import Table

from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.sim.common.table import new_table, shown


def trials_of(choice: dict) -> Table:
    """A row for each model that was tried, before it learned."""
    table = new_table("tried", ("quality", "Gaussians", "bytes", "PSNR, dB", "FPS"))
    for number, trial in enumerate(choice["trials"]):
        chosen = ", chosen" if number == choice["chosen"] else ""
        table.add_row(
            f"degree {trial['degree']}{chosen}", trial["quality"], f"{trial['gaussians']:,}",
            f"{trial['bytes']:,}", shown(trial["psnr_db"], ".2f"),
            shown(trial["fps"], ".0f"),
        )  # fmt: skip
    return table


def table_of(checkpoints: Checkpoints, original: int) -> Table:
    """A row for each step: size, loss, time."""
    headings = ("Gaussians", "SH degree", "bytes", "ratio", "loss", "seconds")
    table = new_table("step", headings)
    for step in checkpoints.steps:
        table.add_row(
            step.name, f"{step.gaussians:,}", str(step.sh_degree), f"{step.bytes:,}",
            f"{original / step.bytes:.1f}", shown(step.loss, ".5f"), f"{step.seconds:.0f}",
        )  # fmt: skip
    return table
