"""Training pictures of a scene without photographs: its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from mmap import mmap

import numpy as np
import torch
import zstandard

from splatcore.model.cameras.capture import teacher_views
from splatcore.model.compress.prune import sound
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.trainable import rendered, tensors_of
from splatcore.spec.camera import Camera
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.scene import Scene

Cameras = Sequence[Camera]

REMEMBERED = 544
"""Pictures of a scene that stay in memory: `compress`' 480 views, and the views used to compare
scenes. Pictures of further views are rendered again each time they are needed."""

LEVEL = 1  # of zstd: a picture of 1920×1080 takes 10 ms; level 3 saves no bytes


@dataclass(frozen=True, eq=False)
class OwnPicture:
    """A `Target` whose image, the scene's own picture, is rendered when it is read."""

    camera: Camera
    see: Callable[[Camera], np.ndarray]

    @property
    def image(self) -> np.ndarray:
        """uint8 [H, W, 3]."""
        return self.see(self.camera)

    @property
    def name(self) -> str:
        return self.camera.name


def teacher_targets(
    scene: Scene, count: int, size: tuple[int, int], seed: int, cameras: Cameras = (),
    beside: float = 0.0, near: float = NEAR_PLANE,
) -> tuple[OwnPicture, ...]:  # fmt: skip
    """Training pictures of a scene.

    size: width and height, pixels
    count, seed, cameras, beside, near: as for `teacher_views`
    """
    views = teacher_views(sound(scene).gaussians(), count, size, seed, cameras, beside, near)
    return pictures(scene, views)


def pictures(scene: Scene, cameras: Cameras) -> tuple[OwnPicture, ...]:
    """The scene's 8-bit pictures from the cameras."""
    with torch.no_grad():
        parameters = rendered(tensors_of(sound(scene)))

    @lru_cache(REMEMBERED)
    @torch.no_grad()
    def kept(camera: Camera) -> mmap:
        image = render(*parameters, camera, antialiased=scene.antialiased).image
        pixels = (image.clamp(0, 1) * 255).round().to(torch.uint8)
        return outside(packed_picture(pixels.cpu().numpy()))

    def see(camera: Camera) -> np.ndarray:
        return unpacked_picture(kept(camera), camera)

    return tuple(OwnPicture(camera, see) for camera in cameras)


def outside(data: bytes) -> mmap:
    """Copy bytes out of the heap, which cannot return freed memory between blocks that stay:
    without this the scene flowers takes twice the memory."""
    place = mmap(-1, len(data))
    place.write(data)
    return place


def packed_picture(image: np.ndarray) -> bytes:
    """Compress a picture, uint8 [H, W, 3], without loss; a smooth one to half its bytes or less.

    Stores differences: red and blue minus green, each pixel minus its left neighbour, each row
    minus the row above; then zstd.
    """
    planes = np.moveaxis(image, 2, 0).copy()
    planes[::2] -= planes[1]
    for axis in (2, 1):
        planes = np.diff(planes, axis=axis, prepend=np.uint8(0))
    return zstandard.compress(planes.tobytes(), LEVEL)


def unpacked_picture(data: bytes | mmap, camera: Camera) -> np.ndarray:
    """Decompress the data of `packed_picture`; the picture has the camera's size."""
    planes = np.frombuffer(zstandard.decompress(data), np.uint8)
    planes = planes.reshape(3, camera.height, camera.width)
    for axis in (1, 2):
        planes = np.cumsum(planes, axis=axis, dtype=np.uint8)
    planes[::2] += planes[1]
    return np.ascontiguousarray(np.moveaxis(planes, 0, 2))
