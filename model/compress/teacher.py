"""Pictures that a scene without photographs learns from: its own."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from splatcore.model.cameras.orbit import orbiting_views
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.cameras.view import core_of
from splatcore.model.compress.prune import sound
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.finetune import Tell
from splatcore.model.gradients.trainable import rendered, tensors_of
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Gaussians, Scene

RISE, NEARER = np.radians(3.0), 1.05
"""Largest deviation of views from the path of given cameras: elevation, and factor of distance. A
hand that holds a camera wavers so."""

Cameras = Sequence[Camera]


def teacher_targets(
    scene: Scene, count: int, size: tuple[int, int], seed: int, tell: Tell, cameras: Cameras = ()
) -> tuple[Target, ...]:
    """Pictures of `size` (width, height) from `count` views of `teacher_views`."""
    scene = sound(scene)
    views = teacher_views(scene.gaussians(), count, size, seed, cameras)
    return tuple(pictures(scene, views, tell))


def teacher_views(
    gaussians: Gaussians, count: int, size: tuple[int, int], seed: int, cameras: Cameras = ()
) -> list[Camera]:
    """`count` views to learn from: from all round, or on the path of `cameras` and never where one
    of them is.

    Few harmonics cannot be right from everywhere: what is learned is best where the views are.
    """
    if not cameras:
        return surrounding_views(gaussians, count, *size, seed)
    given = [camera.resized(*size) for camera in cameras]
    return orbiting_views(given, core_of(gaussians).middle, count, RISE, NEARER, seed)


@torch.no_grad()
def pictures(scene: Scene, cameras: Cameras, tell: Tell) -> Iterator[Target]:
    """The scene's 8-bit pictures from the cameras."""
    parameters = rendered(tensors_of(scene))
    for number, camera in enumerate(cameras):
        image = render(*parameters, camera).image.clamp(0, 1) * 255
        pixels = image.round().to(torch.uint8).cpu().numpy()
        yield Target(camera, pixels, camera.name)
        tell("the scene's own pictures", number + 1, len(cameras), None)
