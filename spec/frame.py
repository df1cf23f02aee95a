"""What a machine is told about a frame: the camera's registers, as values of `Config.arithmetic`.

The host computes them once a frame in float64 and rounds them once; hardware and twin start from
the same codes.
"""

from dataclasses import dataclass

import numpy as np

from spec.camera import Camera
from spec.config import Config
from spec.convention import (
    ALPHA_MIN,
    COVARIANCE_BLUR,
    FRUSTUM_MARGIN,
    NEAR_PLANE,
    PRINCIPAL_POINT_SHIFT,
)
from spec.memory import OPACITY

EXTENT_MARGIN = 2.0
"""Pixels by which a point splat of opacity 1 reaches beyond its centre: √(2·ln 255 · 0.3) < 2."""


@dataclass(frozen=True, eq=False)
class FrameConstants:
    """Registers of one frame."""

    camera: np.ndarray  # [3] int64, grid steps
    principal: np.ndarray  # [2] int64, steps of the screen grid
    near: float
    constants: dict[str, float]  # `spec.microprogram.CONSTANTS`, values the format holds


def frame_constants(
    config: Config, camera: Camera, position_exponent: int, factor_exponent: int
) -> FrameConstants:
    """The registers for a camera and a model's exponents."""
    focal = np.array([camera.fx, camera.fy])
    size = np.array([camera.width, camera.height])
    rows = camera.rotation * np.array([camera.fx, camera.fy, 1.0])[:, None]
    limit = FRUSTUM_MARGIN * size / 2  # 1.3 · tan(fov/2) · focal length
    principal = np.array([camera.cx, camera.cy]) - PRINCIPAL_POINT_SHIFT
    guard = np.maximum(size - 1 - principal, principal) + EXTENT_MARGIN
    spread = np.hypot(focal, limit)  # largest half-extent at z = 1 of what reaches one scene unit
    constants = {
        "zero": 0.0,
        "one": 1.0,
        "grid": 2.0**position_exponent,
        "blur": COVARIANCE_BLUR,
        "reach_slope": -2 * np.log(2) * OPACITY.step,
        "reach_full": -2 * np.log(ALPHA_MIN),
    }
    for axis, name in enumerate("xyz"):
        for k in range(3):
            constants[f"v{name}{k}"] = np.ldexp(rows[axis, k], position_exponent)
            constants[f"w{name}{k}"] = np.ldexp(rows[axis, k], factor_exponent)
    for axis, name in enumerate("xy"):
        constants |= {
            f"guard_{name}": guard[axis],
            f"spread_{name}": spread[axis],
            f"limit_{name}": limit[axis],
        }
    round_ = config.arithmetic.round
    return FrameConstants(
        camera=np.rint(np.ldexp(camera.position, -position_exponent)).astype(np.int64),
        principal=np.rint(np.ldexp(principal, config.screen_fraction)).astype(np.int64),
        near=float(round_(NEAR_PLANE)),
        constants={name: float(round_(value)) for name, value in constants.items()},
    )
