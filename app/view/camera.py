"""Conversion between the page's camera and `spec.camera.Camera`, and placement of the picture.

Both cameras have OpenCV axes. The page's camera is a transform from camera to world, its axis goes
through the middle of the page, and its field of view is vertical. A picture of another shape than
the page fills the page, centred, and loses two edges; if it would lose more than a third, it is
shown whole between borders. Pixels that are not square (fx ≠ fy) are stretched, so that the scene
has its own proportions.
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


def shape_of(camera: Camera) -> tuple[float, float]:
    """Return width and height of a camera's picture on the page, in heights of a pixel."""
    return camera.width * camera.fy / camera.fx, camera.height


def magnification(shape: tuple[float, float], page: Size) -> float:
    """Return the height of a picture's pixel, in pixels of the page. shape: from `shape_of`"""
    whole, filling = sorted((page[0] / shape[0], page[1] / shape[1]))
    return filling if whole >= SHOWN_LEAST * filling else whole


def camera_of(pose: Pose, like: Camera, size: Size, name: str = "") -> Camera:
    """Return the camera of a page's view, for pictures of a size.

    like: camera with the ratio fx / fy and the principal point, which a page does not have
    """
    whole = like.resized(*size)
    focal = pose.page[1] / (2 * np.tan(pose.fov / 2) * magnification(shape_of(whole), pose.page))
    rotation = pose.rotation.T
    return replace(
        whole, fx=whole.fx * focal / whole.fy, fy=focal, rotation=rotation,
        translation=-rotation @ pose.position, name=name,
    )  # fmt: skip


def pose_of(camera: Camera, page: Size) -> Pose:
    """Return the page's camera with the view of a camera."""
    fov = 2 * np.arctan(page[1] / (2 * camera.fy * magnification(shape_of(camera), page)))
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


def framed(pixels: np.ndarray, shape: tuple[float, float], page: Size) -> np.ndarray:
    """Cut edges off a picture [H, W, 3] or add borders: stretched to the page, it has its shape.

    shape: of the picture, from `shape_of`
    """
    high, wide = pixels.shape[:2]
    scale = magnification(shape, page)
    share = page[0] / (scale * shape[0]), page[1] / (scale * shape[1])  # page in pictures
    wide, high = max(1, round(wide * share[0])), max(1, round(high * share[1]))
    spare = np.array([high, wide]) - pixels.shape[:2]
    (top, left), (down, right) = np.maximum(-spare, 0) // 2, np.maximum(spare, 0) // 2
    pixels = pixels[top : top + high, left : left + wide]
    whole = np.full((high, wide, 3), BORDER, np.uint8)
    whole[down : down + len(pixels), right : right + pixels.shape[1]] = pixels
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
