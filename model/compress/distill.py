"""Distillation: a scene with fewer harmonics learns from the scene that still has them."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np
import torch
from numba import njit, prange

from splatcore.model.cameras.surround import perturbed
from splatcore.model.compress.recipe import Recipe
from splatcore.model.gradients import trainable
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.gradients.finetune import Run, difference, optimise, views_in_turn
from splatcore.model.gradients.rendering_points import basis_of
from splatcore.spec.camera import Camera
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.scene import Scene, sh_count

Views = Sequence[Camera]

PERTURBED = 0.5  # share of the steps on perturbed training views
MOVE = 0.1  # largest distance of these from their training view, over the extent of the cameras
TURN = np.radians(5.0)  # largest angle between the two, radians
SHARE = 0.2  # of fine-tuning's learning rates: less has to be repaired here than after pruning
PULL = 0.1  # weight of the old coefficients in the least squares, over the weight of all cameras


def distill(
    scene: Scene, degree: int, cameras: Views, extent: float, recipe: Recipe, run: Run
) -> tuple[trainable.Tensors, float | None]:
    """Distil a scene to harmonics up to `degree`; return its tensors and the mean recent loss.

    extent: of the cameras, scene units
    recipe: learning rate (a share of REFINING) and seed

    Starts from `projected`. Half of the steps are on the cameras, half on perturbed ones; the
    target is the picture of the scene with all of its harmonics.
    """
    with torch.no_grad():
        teacher = [tensor.detach() for tensor in trainable.rendered(trainable.tensors_of(scene))]
    student = trainable.tensors_of(projected(scene, degree, cameras))
    rng = np.random.default_rng(recipe.seed)
    views = [
        perturbed(camera, MOVE * extent, TURN, rng) if rng.random() < PERTURBED else camera
        for camera in islice(views_in_turn(cameras, recipe.seed), run.steps)
    ]

    def picture(parameters: Sequence[torch.Tensor], step: int) -> torch.Tensor:
        return render(*parameters, views[step], antialiased=scene.antialiased).image

    def loss_of(step: int) -> torch.Tensor:
        with torch.no_grad():
            wanted = picture(teacher, step).clamp(0, 1)
        return difference(picture(trainable.rendered(student), step), wanted)

    return student, optimise(trainable.refining(student, SHARE * recipe.rate), run, loss_of)


def projected(scene: Scene, degree: int, cameras: Views) -> Scene:
    """Fit harmonics up to `degree` to the colours of each Gaussian as the cameras see it.

    Least squares per Gaussian over the cameras, weighted by its contribution to their pictures.
    Simply cutting off higher degrees would be right only for Gaussians seen from all directions,
    over which harmonics are orthogonal; seen by few cameras, lower degrees can take over much of
    the higher ones.
    """
    count, sh = sh_count(degree), np.asarray(scene.sh, np.float64)
    matrix, wanted = np.zeros((len(scene), count, count)), np.zeros((len(scene), count, 3))
    for camera, weight in zip(cameras, blending_weights(scene.gaussians(), cameras), strict=True):
        add_equations(scene.position, sh, weight, camera.position, matrix, wanted)
    total = np.maximum(matrix[:, 0, 0], np.finfo(np.float32).tiny)[:, None, None]
    matrix = matrix / total + PULL * np.eye(count)
    wanted = wanted / total + PULL * sh[:, :count]
    return replace(scene, sh=np.linalg.solve(matrix, wanted))


@njit(parallel=True, cache=True)
def add_equations(position, sh, weight, centre, matrix, wanted):
    """Add a camera's normal equations: weight·B·Bᵀ to `matrix` [N, K, K] and weight·B·colour to
    `wanted` [N, K, 3], B the lower harmonics in the camera's direction."""
    count = matrix.shape[1]
    for n in prange(len(position)):
        if weight[n] <= 0:
            continue
        basis = np.empty(16)
        x, y, z = position[n, 0] - centre[0], position[n, 1] - centre[1], position[n, 2] - centre[2]
        length = np.sqrt(x * x + y * y + z * z)
        basis_of(x / length, y / length, z / length, sh.shape[1], basis)
        for channel in range(3):
            colour = 0.0
            for k in range(sh.shape[1]):
                colour += basis[k] * sh[n, k, channel]
            colour = max(colour, -COLOUR_OFFSET)
            for k in range(count):
                wanted[n, k, channel] += weight[n] * basis[k] * colour
        for k in range(count):
            for j in range(count):
                matrix[n, k, j] += weight[n] * basis[k] * basis[j]


def degrees(scene: Scene, last: int) -> range:
    """The degrees to distil to, one after the other, down to `last`."""
    return range(scene.sh_degree - 1, last - 1, -1)
