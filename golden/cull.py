"""Golden model of stage 0: depth of the points of all kept chunks, culled at the near plane."""

import numpy as np

from splatcore.golden.program import Values, run
from splatcore.spec.config import Config
from splatcore.spec.frame import FrameConstants
from splatcore.spec.microprogram import culling
from splatcore.spec.packed import PackedModel


def rays(config: Config, frame: FrameConstants, model: PackedModel, index: np.ndarray) -> Values:
    """Ways [M] from the camera to Gaussians `index` [M] in scene units, along the world axes.

    They are exact on the grid and rounded once, so what is near the camera is precise however
    large its chunk or the scene.
    """
    way = model.grid[index] - frame.camera  # [M, 3] grid steps
    way = np.ldexp(way.astype(np.float64), model.value("position_exponent"))
    return {f"ray_{axis}": config.arithmetic.round(way[:, k]) for k, axis in enumerate("xyz")}


def cull(config: Config, frame: FrameConstants, points: Values) -> tuple[Values, np.ndarray]:
    """Values of the cull program, and which points [N] are kept: z + Δz beyond the near plane.

    Δz is the reach of the point's chunk if `Config.depth_interval`, else 0. Without culling all
    are.
    """
    values = run(config, culling(config.depth_interval), frame.constants | points)
    kept = values["farthest" if config.depth_interval else "z"] > frame.near_plane
    return values, np.full_like(kept, True) if config.culling == "none" else kept
