"""A frame's constants: the camera's registers, as values of `Config.arithmetic`.

The host computes them once per frame in float64 and rounds them once; hardware and golden model
start from the same codes.
"""

from dataclasses import dataclass

import numpy as np

from splatcore.spec import convention
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.depth import rounded_down
from splatcore.spec.error import InputError
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Fixed

EXTENT_MARGIN = 2.0
"""Reach of a point splat of opacity 1 beyond its centre, in pixels: √(2·ln 255·0.3) < 1.83."""

GUARD_ROUNDINGS = 8
"""Margin of the guard band, in roundings of the largest slope.

It covers the errors of a point's x, y and bound together.
"""

SURROUND_MARGIN = 1.01
"""Margin of `surround`, for roundings and rotations that are not exact."""

POWER_SCALE = float(np.log2(np.e) / 2)
"""E = log2(opacity) − Q · POWER_SCALE."""

CAMERA = Fixed(47, 0, signed=True)
"""A camera coordinate in grid steps: up to 2^9 times the distance of the scene's farthest point."""


@dataclass(frozen=True, eq=False)
class FrameConstants:
    """Registers of one frame."""

    camera: np.ndarray  # [3] int64, grid steps
    near_plane: float  # scene units
    constants: dict[str, float]  # name in `spec.programs.CONSTANTS` → rounded value


def fixed_constants(config: Config) -> dict[str, float]:
    """Return the constants of `spec.programs` that no camera changes, before rounding."""
    return {
        "zero": 0.0,
        "one": 1.0,
        "blur": convention.COVARIANCE_BLUR * 4.0**-config.screen_exponent,
        "reach_slope": -2 * np.log(2) * OPACITY.step,
        "reach_full": -2 * np.log(convention.ALPHA_MIN),
        "power": POWER_SCALE,
        "square_reach": convention.SIGMA_EXTENT**2 / 2,
        "spread_least": max(config.arithmetic.epsilon**2, config.arithmetic.min_subnormal),
    }


def frame_constants(
    config: Config,
    camera: Camera,
    position_exponent: int,
    factor_exponent: int,
    antialiased: bool = False,
) -> FrameConstants:
    """Return the registers for a camera and a packed model.

    position_exponent, factor_exponent: from the model's header
    antialiased: whether the model is; the machine itself reads this from the model
    Raises InputError for a camera that is too far away.
    """
    pixel = 2.0**-config.screen_exponent
    focal = np.array([camera.fx, camera.fy]) * pixel
    size = np.array([camera.width, camera.height])
    rows = camera.rotation * np.array([*focal, 1.0])[:, None]
    limit = convention.FRUSTUM_MARGIN * size / 2 * pixel  # 1.3 · tan(fov/2) · focal length
    principal = np.array([camera.cx, camera.cy]) - convention.PRINCIPAL_POINT_SHIFT
    guard = np.maximum(size - 1 - principal, principal) + EXTENT_MARGIN
    guard = guard * (1 + GUARD_ROUNDINGS * config.arithmetic.epsilon) * pixel
    spread = np.hypot(focal, limit)  # half-extent at z = 1 of a reach of one scene unit, at most
    constants = fixed_constants(config) | {"antialiased": float(antialiased)}
    constants["lod"] = camera.lod_pixels / max(camera.fx, camera.fy)
    # If a centre moves by a scene unit, its x moves by focal[0] and its bound by guard[0] at most.
    constants["surround"] = SURROUND_MARGIN * max(spread[0], guard[0] + focal[0])
    for axis, name in enumerate("xyz"):
        for k in range(3):
            constants[f"v{name}{k}"] = rows[axis, k]
            constants[f"w{name}{k}"] = np.ldexp(rows[axis, k], factor_exponent)
    for axis, name in enumerate("xy"):
        constants |= {f"guard_{name}": guard[axis], f"spread_{name}": spread[axis]}
        constants |= {f"limit_{name}": limit[axis], f"principal_{name}": principal[axis] * pixel}
    rounded = {name: float(config.arithmetic.round(value)) for name, value in constants.items()}
    grid = np.rint(np.ldexp(camera.position, -position_exponent))
    if not (np.abs(grid) <= CAMERA.max).all():
        raise InputError(f"camera {camera.name}: is farther away than 512 times the scene's size")
    # Round down: a point within a rounding of the near plane is drawn, not lost.
    near = config.arithmetic.decode(rounded_down(config, camera.near))
    return FrameConstants(grid.astype(np.int64), float(near), rounded)
