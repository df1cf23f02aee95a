"""Distillation: fewer harmonics, taught by the scene that still has them."""

from collections.abc import Sequence

import numpy as np
import torch

from model.differentiable import render
from model.finetune import Tell, difference, optimise, views_in_turn
from model.surround import perturbed
from model.trainable import Tensors, optimizers, rendered, tensors_of
from spec.camera import Camera
from spec.scene import Scene

PERTURBED = 0.5
"""Share of the steps on views beside the training views."""

MOVE = 0.1
"""How far beside, at most: of the extent of the cameras."""

TURN = np.radians(5.0)
"""How far turned, at most."""

RATES = {"sh0": 2.5e-3, "shN": 2.5e-3}
"""Harmonics learn as fast as colours here: they have the most to change."""


def distill(
    scene: Scene,
    degree: int,
    cameras: Sequence[Camera],
    extent: float,
    steps: int,
    seed: int,
    tell: Tell,
    what: str,
) -> tuple[Tensors, float | None]:
    """The scene's parameters with harmonics up to `degree` only, and the loss of the last steps.

    Half of the steps are on the cameras, half on views beside them; the scene's own picture, with
    all of its harmonics, is what the smaller one's should be.
    """
    with torch.no_grad():
        teacher = [tensor.detach() for tensor in rendered(tensors_of(scene))]
    student = tensors_of(scene.with_sh_degree(degree))
    rng = np.random.default_rng(seed)
    views = views_in_turn(cameras, seed)

    def loss_of(step: int) -> torch.Tensor:
        camera = next(views)
        if rng.random() < PERTURBED:
            camera = perturbed(camera, MOVE * extent, TURN, rng)
        with torch.no_grad():
            wanted = render(*teacher, camera).image.clamp(0, 1)
        return difference(render(*rendered(student), camera).image, wanted)

    loss = optimise(optimizers(student, extent, RATES, gentle=True), steps, loss_of, tell, what)
    return student, loss


def degrees(scene: Scene, last: int) -> range:
    """The degrees that are left one after the other until `last`."""
    return range(scene.sh_degree - 1, last - 1, -1)
