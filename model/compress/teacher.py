"""Pictures that a scene without photographs learns from: its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch

from splatcore.model.cameras.capture import teacher_views
from splatcore.model.compress.prune import sound
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.trainable import rendered, tensors_of
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

Cameras = Sequence[Camera]

REMEMBERED = 128
"""Pictures of a scene that stay in memory: those of a round of views (`finetune.ROUND`), and those
by which scenes are compared."""


@dataclass(frozen=True, eq=False)
class OwnPicture:
    """A camera and what the scene shows it: a `Target` whose image is rendered when it is read."""

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
    beside: float = 0.0,
) -> tuple[OwnPicture, ...]:  # fmt: skip
    """Pictures of `size` (width, height) from `count` views of `teacher_views`."""
    views = teacher_views(sound(scene).gaussians(), count, size, seed, cameras, beside)
    return pictures(scene, views)


def pictures(scene: Scene, cameras: Cameras) -> tuple[OwnPicture, ...]:
    """The scene's 8-bit pictures from the cameras."""
    with torch.no_grad():
        parameters = rendered(tensors_of(sound(scene)))

    @lru_cache(REMEMBERED)
    @torch.no_grad()
    def see(camera: Camera) -> np.ndarray:
        image = render(*parameters, camera).image.clamp(0, 1) * 255
        return image.round().to(torch.uint8).cpu().numpy()

    return tuple(OwnPicture(camera, see) for camera in cameras)
