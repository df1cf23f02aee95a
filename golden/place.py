"""Golden model of stage 1's front: x and y of the points that stage 0 kept, and the guard band."""

import numpy as np

from splatcore.golden.program import Values, run
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants
from splatcore.spec.microprogram import program


def place(config: Config, frame: FrameConstants, points: Values) -> tuple[Values, np.ndarray]:
    """Values of the place program, and which points [M] are kept.

    A point leaves if its own depth is not beyond the near plane (with a depth interval stage 0 lets
    some of those through), or if nothing of a Gaussian that reaches as far as its chunk's farthest
    can touch the image: |x| > z·guard + margin. That is never a point too many (`spec.frame`).
    `Config.culling` leaves out the second test or both.
    """
    values = run(config, program("place"), frame.constants | points)
    kept = values["z"] > frame.near_plane
    if config.culling == "none":
        return values, np.full_like(kept, True)
    for axis in "xy" if config.culling == "all" else "":
        kept &= np.abs(values[axis]) <= values[f"bound_{axis}"]
    return values, kept
