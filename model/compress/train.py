"""Training of a plain 3DGS scene from photographs and structure-from-motion points.

Source: Kerbl et al. 2023; densification is gsplat's default strategy. The schedule is theirs, with
its end points in proportion to the number of steps. The loss is L1 and structural similarity.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from numba import njit, prange
from sklearn.neighbors import NearestNeighbors

from splatcore.model.compress.prune import sound
from splatcore.model.formats.colmap import Points
from splatcore.model.formats.file import input_error, reading
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients import trainable
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.finetune import SMOOTHING, Progress, as_tensor, views_in_turn
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import COLOUR_OFFSET, SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene, sh_count

OPACITY = 0.1  # initial opacity of every Gaussian
NEIGHBOURS = 3  # nearest points whose RMS distance is a Gaussian's initial standard deviation

REFINE_START, REFINE_EVERY = 500, 100
REFINE_STOP = 0.5
"""Densification (splitting, cloning and removing Gaussians): first step, interval in steps, and the
share of all steps after which it stops."""

DEGREE_STEPS = 1 / 30  # share of the steps after which the next degree of harmonics is added
DECAY = 0.01  # final share of the positions' learning rate
KEEP_EVERY = 500  # steps between saved states

STATE = "training.pt"

TRAINED = "trained with antialiasing"
"""`Scene.mark` of a scene that was trained with compensated opacities."""

SSIM_SHARE = 0.2  # of the loss on photographs; the rest is L1 (Kerbl et al. 2023).

SIGMA, RADIUS = 1.5, 5  # of the SSIM window, pixels
C1, C2 = 0.01**2, 0.03**2  # constants of Wang et al. 2004, for values 0 … 1.

WINDOW = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * SIGMA**2))
WINDOW /= WINDOW.sum()


def initial_scene(position: np.ndarray, colour: np.ndarray) -> Scene:
    """Round Gaussians at points, as large as the distances between neighbours.

    position: [N, 3] scene units
    colour: [N, 3] uint8
    Raises InputError for too few points.
    """
    if len(position) <= NEIGHBOURS:
        raise InputError(
            f"{len(position)} points are too few; at least {NEIGHBOURS + 1} are needed"
        )
    near = NearestNeighbors(n_neighbors=NEIGHBOURS + 1).fit(position)
    distance = near.kneighbors(position)[0][:, 1:]
    scale = np.sqrt((distance**2).mean(axis=1)).clip(1e-6)
    sh = np.zeros((len(position), sh_count(SH_DEGREE_MAX), 3))
    sh[:, 0] = (colour / 255 - COLOUR_OFFSET) / SH_C0
    return Scene(
        position, np.repeat(scale[:, None], 3, axis=1), np.eye(4)[[0] * len(position)],
        np.full(len(position), OPACITY), sh,
    )  # fmt: skip


def train(
    photographs: Sequence[Target],
    points: Points,
    steps: int,
    seed: int,
    folder: Path,
    progress: Progress,
    antialiased: bool = False,
) -> Scene:
    """Train a scene of SH degree 3.

    points: positions [N, 3] (scene units) and colours [N, 3] to start from
    folder: the state is saved here every 500 steps; another call resumes from it
    progress: see `Progress`
    antialiased: compensate opacities for the blur, and mark the scene

    Raises InputError naming the step if the loss becomes NaN; the last saved state is kept.
    """
    torch.manual_seed(seed)
    extent = trainable.extent_of([target.camera for target in photographs])
    start = initial_scene(*points)
    if antialiased:
        start = replace(start, antialiased=True, mark=TRAINED)
    training = Training(start, extent, steps, seed)
    path = Path(folder) / STATE
    training.load(path)
    views = views_in_turn(photographs, seed)
    for _ in range(training.step):
        next(views)
    mean = None
    while training.step < steps:
        loss = training.advance(next(views))
        if not np.isfinite(loss):
            kept = f"; the last state is in {path}" if path.exists() else ""
            raise InputError(f"training: the loss is {loss} at step {training.step + 1}{kept}")
        mean = loss if mean is None else SMOOTHING * mean + (1 - SMOOTHING) * loss
        phase = f"training, {len(training.tensors['means'])} Gaussians"
        progress(phase, training.step, steps, mean)
        if training.step % KEEP_EVERY == 0:
            training.save(path)
    return sound(trainable.scene_of(training.tensors, start))


class Training:
    """A scene in training: its tensors, their optimizers, and gsplat's densification."""

    def __init__(self, scene: Scene, extent: float, steps: int, seed: int):
        from gsplat import DefaultStrategy

        self.extent, self.steps, self.step = extent, steps, 0
        self.antialiased = scene.antialiased
        self.key = f"{len(scene)} points, {steps} steps, seed {seed}"
        if self.antialiased:
            self.key += ", antialiased"
        leaves = trainable.tensors_of(scene).items()
        self.tensors = {name: torch.nn.Parameter(tensor.detach()) for name, tensor in leaves}
        self.optimizers = trainable.optimizers(self.tensors, extent)
        self.strategy = DefaultStrategy(
            refine_start_iter=REFINE_START,
            refine_stop_iter=int(REFINE_STOP * steps),
            refine_every=REFINE_EVERY,
        )
        self.state = self.strategy.initialize_state(scene_scale=extent)

    def advance(self, target: Target) -> float:
        """Take one step on a photograph; return its loss. A loss that is not finite changes
        nothing."""
        tensors = self.tensors
        centre = tensors["means"].new_zeros((1, len(tensors["means"]), 2), requires_grad=True)
        degree = min(int(self.step / max(DEGREE_STEPS * self.steps, 1)), SH_DEGREE_MAX)
        sh = torch.cat([tensors["sh0"], tensors["shN"][:, : sh_count(degree) - 1]], dim=1)
        found = render(
            tensors["means"], trainable.factor_of(tensors), torch.sigmoid(tensors["opacities"]), sh,
            target.camera, centre[0], antialiased=self.antialiased,
        )  # fmt: skip
        loss = photograph_loss(found.image, as_tensor(target.image, found.image))
        if not torch.isfinite(loss):
            return float(loss.detach())
        camera = target.camera
        seen = torch.zeros((1, len(tensors["means"]), 2), device=centre.device)
        seen[0, torch.as_tensor(found.visible)] = 1
        info = {
            "means2d": centre, "radii": seen, "gaussian_ids": None, "n_cameras": 1,
            "width": camera.width, "height": camera.height,
        }  # fmt: skip
        loss.backward()
        for name, optimizer in self.optimizers.items():
            if tensors[name].grad is not None:
                optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        for group in self.optimizers["means"].param_groups:
            group["lr"] *= DECAY ** (1 / self.steps)
        self.strategy.step_post_backward(
            self.tensors, self.optimizers, self.state, self.step, info, packed=False
        )
        self.step += 1
        return float(loss.detach())

    def save(self, path: Path):
        """Save the state from which training resumes."""
        with reading(path, "cannot be written"):
            path.parent.mkdir(parents=True, exist_ok=True)
        trainable.write_state(path, {
            "key": self.key, "step": self.step, "state": self.state,
            "tensors": {name: tensor.data for name, tensor in self.tensors.items()},
            "optimizers": {name: each.state_dict() for name, each in self.optimizers.items()},
            "random": torch.get_rng_state(),
        })  # fmt: skip

    def load(self, path: Path):
        """Resume from a saved state if the file exists.

        Raises InputError if it belongs to a different training run.
        """
        if not path.exists():
            return
        with reading(path, "is not a state of training"):
            kept = torch.load(path, weights_only=True)
            if kept["key"] != self.key:
                raise input_error(path, f"belongs to a different training run ({kept['key']})")
            for name, tensor in kept["tensors"].items():
                self.tensors[name] = torch.nn.Parameter(tensor)
            self.optimizers = trainable.optimizers(self.tensors, self.extent)
            for name, state in kept["optimizers"].items():
                self.optimizers[name].load_state_dict(state)
            self.step, self.state = kept["step"], kept["state"]
            torch.set_rng_state(kept["random"])


def photograph_loss(picture: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """0.8·L1 + 0.2·(1 − SSIM) of images [H, W, 3]."""
    absolute = (picture - wanted).abs().mean()
    return (1 - SSIM_SHARE) * absolute + SSIM_SHARE * (1 - ssim(picture, wanted))


def ssim(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """Mean structural similarity (Wang et al. 2004) of images [H, W, 3], padded with zeros."""
    a, b = (image.permute(2, 0, 1) for image in (first, second))
    means = blur(torch.cat([a, b, a * a, b * b, a * b]))
    mean_a, mean_b, square_a, square_b, product = means.split(3)
    covariance = product - mean_a * mean_b
    variance = square_a - mean_a * mean_a + square_b - mean_b * mean_b
    above = (2 * mean_a * mean_b + C1) * (2 * covariance + C2)
    below = (mean_a * mean_a + mean_b * mean_b + C1) * (variance + C2)
    return (above / below).mean()


def blur(planes: torch.Tensor) -> torch.Tensor:
    """Blur planes [P, H, W] by WINDOW, padded with zeros."""
    if planes.is_cuda:
        return shifted(shifted(planes, 2), 1)
    return _Blur.apply(planes)


def shifted(planes: torch.Tensor, along: int) -> torch.Tensor:
    """Blur planes [P, H, W] along one dimension, as a sum of shifted planes. cuDNN's convolution
    rounds to TF32 by default, too coarse for the differences that variances are."""
    margin = [RADIUS if dim == along else 0 for dim in (2, 2, 1, 1)]
    padded, size = torch.nn.functional.pad(planes, margin), planes.shape[along]
    return sum(float(w) * padded.narrow(along, k, size) for k, w in enumerate(WINDOW))


class _Blur(torch.autograd.Function):
    """Blur on a CPU, a hundred times as fast as torch's convolution of single channels."""

    @staticmethod
    def forward(context, planes):
        array = planes.detach().numpy()
        return torch.from_numpy(_blurred(array, WINDOW.astype(array.dtype)))

    @staticmethod
    def backward(context, gradient):
        """Blur the gradient: the window is symmetric, so blurring is its own transpose."""
        gradient = np.ascontiguousarray(gradient.numpy())
        return torch.from_numpy(_blurred(gradient, WINDOW.astype(gradient.dtype)))


@njit(parallel=True, cache=True)
def _blurred(planes, window):
    count, height, width = planes.shape
    result = np.empty_like(planes)
    for plane in prange(count):
        down = np.zeros((height, width), planes.dtype)
        for y in range(height):
            for k in range(-RADIUS, RADIUS + 1):
                if 0 <= y + k < height:
                    for x in range(width):
                        down[y, x] += window[k + RADIUS] * planes[plane, y + k, x]
        padded = np.zeros(width + 2 * RADIUS, planes.dtype)
        for y in range(height):
            padded[RADIUS : RADIUS + width] = down[y]
            row = np.zeros(width, planes.dtype)
            for k in range(2 * RADIUS + 1):
                for x in range(width):
                    row[x] += window[k] * padded[x + k]
            result[plane, y] = row
    return result
