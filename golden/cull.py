"""Stage 0's twin: the depth of the points of all chunks that are kept, culled at the near plane."""

import numpy as np

from golden.program import Values, run
from spec.config import Config
from spec.frame import FrameConstants
from spec.memory import CHUNK
from spec.microprogram import culling
from spec.packed import PackedModel


def offsets(config: Config, model: PackedModel, index: np.ndarray) -> Values:
    """Offsets [M] of Gaussians `index` [M] from their chunks' origins, in scene units.

    Those of chunk positions are integers times a power of two, rounded once; absolute positions
    are offsets from 0.
    """
    if model.format.position == "absolute":
        offset = model.position[index]
    else:
        shift = model.chunks["shift"].astype(np.int64)[index // CHUNK]
        steps = shift + model.value("position_exponent")
        offset = np.ldexp(model.offsets[index].astype(np.float64), steps)
    return {f"offset_{axis}": config.arithmetic.round(offset[:, k]) for k, axis in enumerate("xyz")}


def cull(config: Config, frame: FrameConstants, points: Values) -> tuple[Values, np.ndarray]:
    """Values of the cull program, and which points [N] are kept: z + Δz beyond the near plane.

    Δz is the reach of the point's chunk if `Config.depth_interval`, else 0.
    """
    values = run(config, culling(config.depth_interval), frame.constants | points)
    return values, values["farthest" if config.depth_interval else "z"] > frame.near_plane
