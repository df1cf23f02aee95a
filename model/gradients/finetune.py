"""Fine-tuning: Adam on the parameters of a scene until its pictures are those it should have."""

from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np
import torch

from splatcore.model.formats.photographs import Target
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.trainable import Optimizers, Tensors, rendered
from splatcore.model.gradients.unfinished import KEEP_EVERY, Unfinished
from splatcore.spec.error import InputError

Tell = Callable[[str, int, int, float | None], None]
"""Progress callback: activity, steps done, steps in all, mean loss of the last steps."""

WARM_UP = 10
"""Steps in which the learning rates rise: Adam's first steps are as long as its longest."""

LAPS = 4  # over the views, after which these are shuffled from a new order

FLOOR = 1e-10  # of the mean squared error, at whose root the gradient would be infinite

SMOOTHING = 0.95  # weight of the past in the moving average of the loss


def views_in_turn(targets: Sequence, seed: int) -> Iterator:
    """The targets in random order, the same for the same seed: all before one of them comes
    again; of views that came again and again the last would be learned, the first forgotten."""
    rng = np.random.default_rng(seed)
    while True:
        order = rng.permutation(len(targets))
        for _ in range(LAPS):
            for index in rng.permutation(order):
                yield targets[index]


def as_tensor(image: np.ndarray, like: torch.Tensor) -> torch.Tensor:
    """A uint8 image [H, W, 3] as numbers 0 … 1."""
    return torch.from_numpy(image).to(like.device).to(like.dtype) / 255


def difference(picture: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Root of the mean squared error of a picture, clipped as the 8-bit one is; PSNR is its
    logarithm. With the paper's pure L1 a capture loses 0.3 dB more (docs/compression.md).
    """
    return ((picture.clamp(0, 1) - wanted).square().mean() + FLOOR).sqrt()


def optimise(
    optimizers: Optimizers,
    steps: int,
    loss_of: Callable[[int], torch.Tensor],
    tell: Tell,
    what: str,
    left: float,
    kept: Unfinished | None = None,
) -> float | None:
    """`steps` steps of Adam with learning rates that rise, then fall by the same share a step until
    the share `left`; returns the mean loss lately.

    `loss_of` a step is its loss. Goes on after the steps that `kept` has a state of. InputError,
    saying at which step, if the loss is NaN or infinite: the parameters are not changed by it.
    """
    falling = left ** (1 / max(steps, 1))
    full = {name: optimizer.param_groups[0]["lr"] for name, optimizer in optimizers.items()}
    done, mean = kept.load(optimizers) if kept else (0, None)
    for step in range(done, steps):
        loss = loss_of(step)
        value = float(loss.detach())
        if not np.isfinite(value):
            raise InputError(f"{what}: the loss is {value} at step {step + 1} of {steps}")
        loss.backward()
        for name, optimizer in optimizers.items():
            rise = min((step + 1) / WARM_UP, 1.0)
            optimizer.param_groups[0]["lr"] = full[name] * rise * falling**step
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        mean = value if mean is None else SMOOTHING * mean + (1 - SMOOTHING) * value
        tell(what, step + 1, steps, mean)
        if kept and (step + 1) % KEEP_EVERY == 0:
            kept.save(optimizers, step + 1, mean)
    return mean


def finetune(
    tensors: Tensors,
    optimizers: Optimizers,
    targets: Sequence[Target],
    steps: int,
    seed: int,
    tell: Tell,
    what: str,
    left: float,
    parameters: Callable[[Tensors], tuple[torch.Tensor, ...]] = rendered,
    kept: Unfinished | None = None,
    antialiased: bool = False,
) -> float | None:
    """Fit a scene to its targets by `difference`; returns the mean loss of the last steps.

    `parameters` makes of the tensors what is rendered; `left` and `kept` are those of `optimise`,
    `antialiased` is the scene's.
    """
    views = list(islice(views_in_turn(targets, seed), steps))

    def loss_of(step: int) -> torch.Tensor:
        camera = views[step].camera
        picture = render(*parameters(tensors), camera, antialiased=antialiased).image
        return difference(picture, as_tensor(views[step].image, picture))

    return optimise(optimizers, steps, loss_of, tell, what, left, kept)
