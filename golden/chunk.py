"""Golden model of stage 0's front: values that a chunk's points share, and chunks to skip."""

import numpy as np

from splatcore.golden.program import Values, run
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants
from splatcore.spec.memory import EXTENT_SHIFT
from splatcore.spec.microprogram import program
from splatcore.spec.packed import PackedModel
from splatcore.spec.programs import CORNERS


def chunk(config: Config, frame: FrameConstants, model: PackedModel) -> tuple[Values, np.ndarray]:
    """Values of the chunk program, and which chunks [C] are kept.

    The ways from the camera to a chunk's ends along the world axes are exact on the grid and
    rounded once. A chunk is skipped if the bounds of its points are behind the near plane or beyond
    the guard band: `place` would drop every one of them. Absolute positions have no extent, and no
    chunk is skipped; nor is any without culling, or beyond the guard band if the near plane alone
    culls.
    """
    headers, round_ = model.chunks, config.arithmetic.round
    exponent = model.value("position_exponent")
    low = headers["origin"].astype(np.int64) - frame.camera  # [C, 3] grid steps
    shift = headers["shift"].astype(np.int64) + EXTENT_SHIFT
    high = low + ((headers["extent"].astype(np.int64) + 1) << shift)
    ends = [round_(np.ldexp(end.astype(np.float64), exponent)) for end in (low, high)]
    fields: Values = {"chunk_reach": round_(headers["reach"])}
    for name, (constant, side) in CORNERS.items():
        falls = frame.constants[constant] < 0
        fields[name] = ends[falls != (side == "most")][:, int(name[-1])]
    values = run(config, program("chunk"), frame.constants | fields)
    if model.format.position == "absolute" or config.culling == "none":
        return values, np.ones(len(low), bool)
    kept = values["z_high"] > frame.near_plane
    for axis in "xy" if config.culling == "all" else "":
        kept &= values[f"{axis}_low"] <= values[f"far_{axis}"]
        kept &= -values[f"{axis}_high"] <= values[f"far_{axis}"]
    return values, kept
