"""Stage 0's twin: chunks' constants, and the depth of every point, culled at the near plane."""

import numpy as np

from golden.program import Values, run
from spec.config import Config
from spec.frame import FrameConstants
from spec.microprogram import program


def chunk_constants(
    config: Config, frame: FrameConstants, origin: np.ndarray, reach: np.ndarray
) -> Values:
    """Values [C] of the chunk program for chunks with grid origins [C, 3] and reaches [C].

    The way from camera to origin is exact on the grid and rounded once.
    """
    format = config.arithmetic
    away = format.round((origin - frame.camera).astype(np.float64))
    fields = {f"away_{axis}": away[:, k] for k, axis in enumerate("xyz")}
    fields["chunk_reach"] = format.round(reach)
    return run(config, program("chunk"), frame.constants | fields)


def scaled_offsets(config: Config, offset: np.ndarray, shift: np.ndarray) -> Values:
    """Offsets [N, 3] with shifts [N, 3] as floats in grid steps; the shift moves the exponent."""
    steps = np.ldexp(config.arithmetic.round(offset.astype(np.float64)), shift)
    return {f"offset_{axis}": steps[:, k] for k, axis in enumerate("xyz")}


def cull(
    config: Config, frame: FrameConstants, points: Values, reach: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Depths [N] of points, and which of them [N] are kept: z + Δz beyond the near plane.

    `points` are the cull program's fields; Δz is the reach [N] of the point's chunk if
    `Config.depth_interval`, else 0.
    """
    depth = run(config, program("cull"), frame.constants | points)["z"]
    farthest = config.arithmetic.round(depth + reach) if config.depth_interval else depth
    return depth, farthest > frame.near
