"""Tables of `splatcore compress`: trials and steps."""

from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.sim.common.table import Column, Table

SIZES = [Column("Gaussians", digits=0, get="gaussians"), Column("bytes", digits=0)]


def trials_of(choice: dict) -> Table:
    """Table of the trial models, one row each, with their values before fine-tuning."""
    rows = [
        trial | {"trial": f"degree {trial['degree']}" + ", chosen" * (number == choice["chosen"])}
        for number, trial in enumerate(choice["trials"])
    ]
    last = [Column("PSNR", "dB", 2, get="psnr_db"), Column("FPS", digits=0, get="fps")]
    return Table.of("trials", "", [Column("trial"), Column("quality"), *SIZES, *last], rows)


def table_of(checkpoints: Checkpoints, original: int) -> Table:
    """Table of the steps, one row each. original: bytes of the original, for the ratio."""
    columns = [
        Column("step", get="name"), *SIZES, Column("SH degree", digits=0, get="sh_degree"),
        Column("ratio", digits=1, get=lambda step: original / step["bytes"]),
        Column("loss", digits=5), Column("seconds", digits=0),
    ]  # fmt: skip
    return Table.of("steps", "", columns, map(vars, checkpoints.steps))
