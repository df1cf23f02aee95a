"""Pictures that a scene without photographs learns from: its own."""

from collections.abc import Iterator, Sequence

import torch

from splatcore.model.cameras.capture import teacher_views
from splatcore.model.compress.prune import sound
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.finetune import Tell
from splatcore.model.gradients.trainable import rendered, tensors_of
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

Cameras = Sequence[Camera]


def teacher_targets(
    scene: Scene, count: int, size: tuple[int, int], seed: int, tell: Tell, cameras: Cameras = (),
    beside: float = 0.0,
) -> tuple[Target, ...]:  # fmt: skip
    """Pictures of `size` (width, height) from `count` views of `teacher_views`."""
    scene = sound(scene)
    views = teacher_views(scene.gaussians(), count, size, seed, cameras, beside)
    return tuple(pictures(scene, views, tell))


@torch.no_grad()
def pictures(scene: Scene, cameras: Cameras, tell: Tell) -> Iterator[Target]:
    """The scene's 8-bit pictures from the cameras."""
    parameters = rendered(tensors_of(scene))
    for number, camera in enumerate(cameras):
        image = render(*parameters, camera).image.clamp(0, 1) * 255
        pixels = image.round().to(torch.uint8).cpu().numpy()
        yield Target(camera, pixels, camera.name)
        tell("the scene's own pictures", number + 1, len(cameras), None)
