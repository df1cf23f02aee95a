"""A frame's constants: the camera's registers, as values of `Config.arithmetic`.

The host computes them once a frame in float64 and rounds them once; hardware and golden model start
from the same codes.
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
"""Pixels by which a point splat of opacity 1 reaches beyond its centre: √(2·ln 255·0.3) < 1.83."""

GUARD_ROUNDINGS = 8
"""Roundings of the largest slope by which the guard band is wider than it need be: what a point's
x, y and bound may be off by, together."""

POWER_SCALE = float(np.log2(np.e) / 2)
"""E = log2(opacity) − Q · this."""

CAMERA = Fixed(47, 0, signed=True)
"""The camera's coordinates in grid steps: up to 2^9 times as far as the scene's farthest point."""


@dataclass(frozen=True, eq=False)
class FrameConstants:
    """Registers of one frame."""

    camera: np.ndarray  # [3] int64, grid steps
    near_plane: float
    constants: dict[str, float]  # `spec.programs.CONSTANTS`, values that the format holds


def fixed_constants(config: Config) -> dict[str, float]:
    """Constants of `spec.programs` that no camera changes, before they are rounded."""
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
    """The registers for a camera and a model's exponents; and whether the model is antialiased,
    which the machine itself reads from the model.

    Raises InputError for a camera that is too far off.
    """
    pixel = 2.0**-config.screen_exponent
    focal = np.array([camera.fx, camera.fy]) * pixel
    size = np.array([camera.width, camera.height])
    rows = camera.rotation * np.array([*focal, 1.0])[:, None]
    limit = convention.FRUSTUM_MARGIN * size / 2 * pixel  # 1.3 · tan(fov/2) · focal length
    principal = np.array([camera.cx, camera.cy]) - convention.PRINCIPAL_POINT_SHIFT
    guard = np.maximum(size - 1 - principal, principal) + EXTENT_MARGIN
    guard = guard * (1 + GUARD_ROUNDINGS * config.arithmetic.epsilon) * pixel
    spread = np.hypot(focal, limit)  # largest half-extent at z = 1 of what reaches one scene unit
    constants = fixed_constants(config) | {"antialiased": float(antialiased)}
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
        raise InputError(f"camera {camera.name}: is more than 512 times the scene's size away")
    # What is within a rounding of the near plane is rather drawn than lost.
    near = config.arithmetic.decode(rounded_down(config, camera.near))
    return FrameConstants(grid.astype(np.int64), float(near), rounded)
