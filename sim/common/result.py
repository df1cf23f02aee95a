"""The object that `--json` writes. Its keys are documented in `docs/json.md`."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from splatcore.sim.common.metric import Difference
from splatcore.sim.common.output import write


@dataclass
class Result:
    """One rendered or compared image; None where a command has nothing to say."""

    engine: str
    preset: str
    scene: str | None = None
    camera: str | None = None
    size: tuple[int, int] | None = None  # width, height
    seconds: float | None = None
    counts: dict[str, int | float] = field(default_factory=dict)
    psnr_db: float | None = None
    ssim: float | None = None
    max_error: float | None = None
    identical: bool | None = None
    cycles: int | None = None
    fps_at_800mhz: float | None = None
    traffic_bytes: dict[str, int] | None = None

    def with_difference(self, difference: Difference) -> "Result":
        """Fill in the metrics; returns self."""
        for name, value in asdict(difference).items():
            setattr(self, name, value)
        self.identical = difference.identical
        return self


def write_json(path: Path | None, value: object):
    """Write an object (a dataclass or a dict) as JSON, if there is a path to write to."""
    if path is not None:
        value = value if isinstance(value, dict) else asdict(value)
        write(path, (json.dumps(value, indent=2, allow_nan=False) + "\n").encode())
