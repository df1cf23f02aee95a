"""The twin of stage 0's front: what all points of a chunk share, and which chunks are skipped."""

import numpy as np

from golden.program import Values, run
from spec.config import Config
from spec.frame import FrameConstants
from spec.memory import EXTENT_SHIFT
from spec.microprogram import program
from spec.packed import PackedModel


def chunk(config: Config, frame: FrameConstants, model: PackedModel) -> tuple[Values, np.ndarray]:
    """Values of the chunk program, and which chunks [C] are kept.

    The way from the camera to a chunk's origin is exact on the grid and rounded once, and so is
    the largest offset that its extent admits. A chunk is skipped if the bounds of its points are
    behind the near plane or beyond the guard band: `place` would drop every one of them. Absolute
    positions have no extent, and no chunk is skipped.
    """
    headers, round_ = model.chunks, config.arithmetic.round
    exponent = model.value("position_exponent")
    away = headers["origin"].astype(np.int64) - frame.camera  # [C, 3] grid steps
    extent = (headers["extent"].astype(np.int64) + 1) << EXTENT_SHIFT
    steps = headers["shift"].astype(np.int64) + exponent
    fields: Values = {"chunk_reach": round_(headers["reach"])}
    for k, axis in enumerate("xyz"):
        fields[f"away_{axis}"] = round_(np.ldexp(away[:, k].astype(np.float64), exponent))
        fields[f"extent_{axis}"] = round_(np.ldexp(extent[:, k].astype(np.float64), steps[:, k]))
    values = run(config, program("chunk"), frame.constants | fields)
    if model.format.position == "absolute":
        return values, np.ones(len(extent), bool)
    kept = values["z_high"] > frame.near_plane
    for axis in "xy":
        kept &= values[f"{axis}_low"] <= values[f"far_{axis}"]
        kept &= -values[f"{axis}_high"] <= values[f"far_{axis}"]
    return values, kept
