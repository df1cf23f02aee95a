"""Fine-tuning: Adam on a scene's parameters, so that its pictures match their targets.

Unfinished fine-tuning resumes from its saved state with bit-identical results.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from splatcore.model.formats.file import input_error, reading
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.trainable import Optimizers, Tensors, rendered, write_state
from splatcore.spec.error import InputError

Progress = Callable[[str, int, int, float | None], None]
"""Progress callback: phase, steps done, steps in all, mean recent loss (None: no loss yet)."""

WARM_UP = 10
"""Steps over which the learning rates rise, because Adam's first steps are as long as any later."""

LAPS = 4  # rounds over the views before a new random order is drawn

FLOOR = 1e-10  # added to the mean squared error, whose root has an infinite gradient at 0

SMOOTHING = 0.95  # weight of the past in the moving average of the loss

KEEP_EVERY = 100
"""Steps between saved states: three minutes for the scene flowers at full HD."""


@dataclass(frozen=True)
class Unfinished:
    """The file for the state of a fine-tuning. Learning rates are not saved: `optimise` recomputes
    them."""

    path: Path
    more: Callable[[], list[torch.Tensor]] = list  # further tensors that change, not optimised

    def save(self, optimizers: Optimizers, step: int, loss: float):
        """Save the state after `step` steps; `loss`: the mean recent loss."""
        state = {
            "step": step, "loss": loss, "tensors": self.tensors(optimizers),
            "moments": {name: each.state_dict()["state"] for name, each in optimizers.items()},
        }  # fmt: skip
        write_state(self.path, state)

    def load(self, optimizers: Optimizers) -> tuple[int, float | None]:
        """Restore the saved state; return the number of finished steps (0 without a file) and the
        mean recent loss.

        Raises InputError if the file is broken or belongs to a different fine-tuning.
        """
        if not self.path.exists():
            return 0, None
        with reading(self.path, "is not a state of this fine-tuning; remove it"):
            state = torch.load(self.path, weights_only=True)
            tensors = self.tensors(optimizers)
            if [each.shape for each in state["tensors"]] != [each.shape for each in tensors]:
                raise input_error(self.path, "belongs to a different fine-tuning; remove it")
            for name, optimizer in optimizers.items():
                groups = optimizer.state_dict()["param_groups"]
                moments = state["moments"][name]
                optimizer.load_state_dict({"state": moments, "param_groups": groups})
            for tensor, kept in zip(tensors, state["tensors"], strict=True):
                tensor.copy_(kept)
            return state["step"], state["loss"]

    def tensors(self, optimizers: Optimizers) -> list[torch.Tensor]:
        """All tensors that a step changes, the optimizers' first."""
        groups = [group for each in optimizers.values() for group in each.param_groups]
        learned = [tensor.detach() for group in groups for tensor in group["params"]]
        return learned + self.more()


class Run(NamedTuple):
    """A run of steps of Adam."""

    phase: str  # name for `progress` and for messages
    steps: int
    left: float  # final share of the learning rates
    progress: Progress
    kept: Unfinished | None = None  # saved state to resume from, and to save to


def views_in_turn(targets: Sequence, seed: int) -> Iterator:
    """Yield the targets endlessly in random order, deterministic for a seed.

    Each round covers all targets, so that none is forgotten while others are repeated.
    """
    rng = np.random.default_rng(seed)
    while True:
        order = rng.permutation(len(targets))
        for _ in range(LAPS):
            for index in rng.permutation(order):
                yield targets[index]


def as_tensor(image: np.ndarray, like: torch.Tensor) -> torch.Tensor:
    """A uint8 image [H, W, 3] as a tensor of values 0 … 1, with type and device of `like`."""
    return torch.from_numpy(image).to(like.device).to(like.dtype) / 255


def difference(picture: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Root mean squared error of a picture, clipped like its 8-bit version; PSNR is its logarithm.

    With the paper's pure L1 loss a capture is 0.3 dB worse (docs/notes/2026-11-compression.md).
    """
    return ((picture.clamp(0, 1) - wanted).square().mean() + FLOOR).sqrt()


def optimise(
    optimizers: Optimizers, run: Run, loss_of: Callable[[int], torch.Tensor]
) -> float | None:
    """Take the steps of a run; return the mean recent loss.

    loss_of: the loss of a step

    Learning rates rise during warm-up and then decay exponentially. Raises InputError naming the
    step if the loss is NaN or infinite; that step changes nothing.
    """
    phase, steps, left, progress, kept = run
    falling = left ** (1 / max(steps, 1))
    full = {name: optimizer.param_groups[0]["lr"] for name, optimizer in optimizers.items()}
    done, mean = kept.load(optimizers) if kept else (0, None)
    for step in range(done, steps):
        loss = loss_of(step)
        value = float(loss.detach())
        if not np.isfinite(value):
            raise InputError(f"{phase}: the loss is {value} at step {step + 1} of {steps}")
        loss.backward()
        for name, optimizer in optimizers.items():
            rise = min((step + 1) / WARM_UP, 1.0)
            optimizer.param_groups[0]["lr"] = full[name] * rise * falling**step
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        mean = value if mean is None else SMOOTHING * mean + (1 - SMOOTHING) * value
        progress(phase, step + 1, steps, mean)
        if kept and (step + 1) % KEEP_EVERY == 0:
            kept.save(optimizers, step + 1, mean)
    return mean


def finetune(
    tensors: Tensors,
    optimizers: Optimizers,
    targets: Sequence[Target],
    seed: int,
    run: Run,
    parameters: Callable[[Tensors], tuple[torch.Tensor, ...]] = rendered,
    antialiased: bool = False,
) -> float | None:
    """Fit a scene to its targets by `difference`; return the mean recent loss.

    parameters: converts the tensors to arguments of `differentiable.render`
    antialiased: the scene's mark
    """
    views = list(islice(views_in_turn(targets, seed), run.steps))

    def loss_of(step: int) -> torch.Tensor:
        camera = views[step].camera
        picture = render(*parameters(tensors), camera, antialiased=antialiased).image
        return difference(picture, as_tensor(views[step].image, picture))

    return optimise(optimizers, run, loss_of)
