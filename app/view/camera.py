"""Conversion between the page's camera and `spec.camera.Camera`, and placement of the picture.

Both cameras have OpenCV axes. The page's camera is a transform from camera to world, its axis goes
through the middle of the page, and its field of view is vertical. A picture of another shape than
the page fills the page, centred, and loses two edges; if it would lose more than a third, it is
shown whole between borders.
"""

from dataclasses import dataclass, replace

import numpy as np

from splatcore.model.cameras.orbit import upright
from splatcore.spec.binning import fits
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config

Size = tuple[int, int]
"""Width and height in pixels."""

BORDER = 24  # level of the borders around a picture of another shape

SHOWN_LEAST = 2 / 3
"""Minimum share of a picture that stays visible when it fills a page of another shape."""


@dataclass(frozen=True, eq=False)
class Pose:
    """The camera of a page.

    rotation: [3, 3], camera to world
    position: [3], scene units
    fov: vertical field of view of the page, radians
    page: size of the page
    """

    rotation: np.ndarray
    position: np.ndarray
    fov: float
    page: Size

    def same(self, other: "Pose | None") -> bool:
        """Return whether two poses look the same."""
        if other is None or self.page != other.page:
            return False
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return all(np.allclose(one, two, rtol=1e-6, atol=1e-9) for one, two in pairs)


def magnification(size: Size, page: Size) -> float:
    """Return the side of a picture's pixel, in pixels of the page."""
    whole, filling = sorted((page[0] / size[0], page[1] / size[1]))
    return filling if whole >= SHOWN_LEAST * filling else whole


def camera_of(pose: Pose, like: Camera, size: Size, name: str = "") -> Camera:
    """Return the camera of a page's view, for pictures of a size.

    like: camera with the ratio fx / fy and the principal point, which a page does not have
    """
    whole = like.resized(*size)
    focal = pose.page[1] / (2 * np.tan(pose.fov / 2) * magnification(size, pose.page))
    rotation = pose.rotation.T
    return replace(
        whole, fx=whole.fx * focal / whole.fy, fy=focal, rotation=rotation,
        translation=-rotation @ pose.position, name=name,
    )  # fmt: skip


def pose_of(camera: Camera, page: Size) -> Pose:
    """Return the page's camera with the view of a camera."""
    size = camera.width, camera.height
    fov = 2 * np.arctan(page[1] / (2 * camera.fy * magnification(size, page)))
    return Pose(camera.rotation.T, camera.position, float(fov), page)


def up_of(cameras: list[Camera]) -> np.ndarray:
    """Return the up direction [3] of a scene with these cameras, the page's axis of rotation."""
    return upright(cameras)


def level_up(camera: Camera, up: np.ndarray) -> np.ndarray:
    """Return the direction [3] nearest to `up` [3] that is vertical in a camera's picture.

    A page's camera has a viewing direction and an up direction, no tilt about its axis.
    """
    right, own = camera.rotation[0], -camera.rotation[1]
    found = up - (up @ right) * right
    return found / np.linalg.norm(found) if found @ own > 0.05 else own


def framed(pixels: np.ndarray, page: Size) -> np.ndarray:
    """Give a picture [H, W, 3] the shape of the page: cut edges off or add borders."""
    height, width = pixels.shape[:2]
    scale = magnification((width, height), page)
    wide, high = max(1, round(page[0] / scale)), max(1, round(page[1] / scale))
    top, left = max(0, height - high) // 2, max(0, width - wide) // 2
    pixels = pixels[top : top + high, left : left + wide]
    height, width = pixels.shape[:2]
    whole = np.full((high, wide, 3), BORDER, np.uint8)
    top, left = (high - height) // 2, (wide - width) // 2
    whole[top : top + height, left : left + width] = pixels
    return whole


def within(size: Size, most: Size) -> Size:
    """Return the largest size of the same shape within `most`, at most `size` itself."""
    scale = min(1, most[0] / size[0], most[1] / size[1])
    return max(1, int(size[0] * scale + 1e-9)), max(1, int(size[1] * scale + 1e-9))


def fitting(config: Config, size: Size) -> Size:
    """Return the size, or the largest of its shape that a machine renders."""
    width, height = size
    for scale in range(4096, 0, -1):
        width, height = (max(1, side * scale // 4096) for side in size)
        if fits(config, width, height):
            break
    return width, height
