"""PSNR of scenes and models against some of the training pictures."""

from collections.abc import Sequence

import numpy as np
import torch

from splatcore.model.formats.photographs import Target
from splatcore.model.gradients import trainable
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.finetune import as_tensor
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.scene import Gaussians, Scene

JUDGED = 6  # views by which models are compared


def spread(views: Sequence, most: int) -> Sequence:
    """At most `most` of the views, picked evenly."""
    return views[:: -(-len(views) // most)]


def best_looking(versions: Sequence, targets: Sequence[Target]):
    """The scene or packed model with the highest PSNR on some of the targets: fine-tuning with
    almost no loss can make a scene worse."""
    some = spread(targets, JUDGED)
    return max(versions, key=lambda version: decibels(version.gaussians(), some))


@torch.no_grad()
def decibels(scene: Scene | Gaussians, targets: Sequence[Target]) -> float:
    """PSNR in dB of the scene's pictures against the targets, over all their pixels."""
    seen = scene.gaussians() if isinstance(scene, Scene) else scene
    arrays = (seen.position, seen.factor, seen.opacity, seen.sh)
    kind = {"dtype": torch.float32, "device": trainable.device()}
    parameters = [torch.tensor(array, **kind) for array in arrays]
    squares, count = 0.0, 0
    for target in targets:
        picture = render(*parameters, target.camera, antialiased=seen.antialiased).image
        squares += float(((picture.clamp(0, 1) - as_tensor(target.image, picture)) ** 2).sum())
        count += target.image.size
    return psnr_of_square(max(squares / count, np.finfo(float).tiny))
