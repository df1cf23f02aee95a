"""Tables of `splatcore compress`: trials and steps."""

from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.sim.common.table import Column, Table

TRIAL = (
    Column("trial"),
    Column("quality", digits=0),
    Column("Gaussians", digits=0, get="gaussians"),
    Column("bytes", digits=0),
    Column("PSNR", "dB", 2, get="psnr_db"),
    Column("FPS", digits=0, get="fps"),
)

STEP = (
    Column("step", get="name"),
    Column("Gaussians", digits=0, get="gaussians"),
    Column("SH degree", digits=0, get="sh_degree"),
    Column("bytes", digits=0),
    Column("ratio", digits=1),
    Column("loss", digits=5),
    Column("seconds", digits=0),
)


def trials_of(choice: dict) -> Table:
    """Table of the trial models, one row each, with their values before fine-tuning."""
    rows = []
    for number, trial in enumerate(choice["trials"]):
        chosen = ", chosen" if number == choice["chosen"] else ""
        rows.append(trial | {"trial": f"degree {trial['degree']}{chosen}"})
    return Table.of("trials", "", TRIAL, rows)


def table_of(checkpoints: Checkpoints, original: int) -> Table:
    """Table of the steps, one row each. original: bytes of the original, for the ratio."""
    rows = (vars(step) | {"ratio": original / step.bytes} for step in checkpoints.steps)
    return Table.of("steps", "", STEP, rows)
