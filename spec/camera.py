"""A pinhole camera with OpenCV axes: x right, y down, z forward."""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.error import InputError

SIZE_MAX = 8192
"""Maximum pixels per side of a picture, for every command and renderer."""

SIDE_MAX = 2**31 - 1
"""Maximum pixels per side of a camera, whose pictures may be smaller."""

NEAR_LIMITS = (1e-5, 1e5)
"""Smallest and largest `Camera.near`, scene units."""
LOD_MAX = 2.0**20
"""Largest `Camera.lod_pixels`."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics in pixels, the world-to-camera transform, the near plane and the level of detail.

    A world point x has the camera coordinates p = rotation @ x + translation and projects to
    u = fx·p.x/p.z + cx − 0.5, v likewise (pixel centres are integers).
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    rotation: np.ndarray  # [3, 3] world to camera
    translation: np.ndarray  # [3] world to camera, scene units
    name: str = ""
    near: float = NEAR_PLANE  # Gaussians with a centre depth up to this are left out
    lod_pixels: float = 0.0  # error up to which a model's coarser levels are drawn; 0: none is

    def __post_init__(self):
        object.__setattr__(self, "rotation", np.asarray(self.rotation, np.float64))
        object.__setattr__(self, "translation", np.asarray(self.translation, np.float64))
        for field in ("width", "height"):
            size = getattr(self, field)
            if not 1 <= size <= SIDE_MAX:
                raise InputError(f"camera {self.name}: {field} {size} is not in 1 … {SIDE_MAX}")
        if not NEAR_LIMITS[0] <= self.near <= NEAR_LIMITS[1]:
            low, high = NEAR_LIMITS
            raise InputError(f"camera {self.name}: near {self.near} is not in {low:g} … {high:g}")
        if not 0 <= self.lod_pixels <= LOD_MAX:
            why = f"lod_pixels {self.lod_pixels} is not in 0 … {LOD_MAX:g}"
            raise InputError(f"camera {self.name}: {why}")
        for field in ("fx", "fy"):
            if not (np.isfinite(getattr(self, field)) and getattr(self, field) > 0):
                raise InputError(f"camera {self.name}: {field} {getattr(self, field)} is not > 0")
        for field, shape in (("cx", ()), ("cy", ()), ("rotation", (3, 3)), ("translation", (3,))):
            value = np.asarray(getattr(self, field))
            if value.shape != shape or not np.isfinite(value).all():
                raise InputError(f"camera {self.name}: {field} is not a finite {shape} array")

    @property
    def position(self) -> np.ndarray:
        """Camera centre in world coordinates, [3]."""
        return -self.rotation.T @ self.translation

    @property
    def tan_half_fov(self) -> tuple[float, float]:
        """tan(fov/2), horizontal and vertical, as the original renderer defines it."""
        return self.width / (2 * self.fx), self.height / (2 * self.fy)

    def resized(self, width: int, height: int) -> "Camera":
        """Return the same view with another number of pixels; intrinsics scale with the sides."""
        kx, ky = width / self.width, height / self.height
        scaled = {"fx": self.fx * kx, "fy": self.fy * ky, "cx": self.cx * kx, "cy": self.cy * ky}
        return replace(self, width=width, height=height, **scaled)


def look_at(
    position: np.ndarray,
    target: np.ndarray,
    width: int,
    height: int,
    focal: float,
    down: np.ndarray = (0.0, 1.0, 0.0),
    name: str = "",
) -> Camera:
    """Return a camera that looks from one point at another.

    position: [3] world space, scene units
    target: [3] world space, scene units
    width, height: image size, pixels
    focal: focal length of both axes, pixels
    down: [3] direction of the image's +y; the default suits 3DGS scenes, in which y points down
    name: name of the camera
    """
    forward = np.asarray(target, np.float64) - position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(np.asarray(down, np.float64), forward)
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    translation = -rotation @ np.asarray(position, np.float64)
    return Camera(width, height, focal, focal, width / 2, height / 2, rotation, translation, name)
