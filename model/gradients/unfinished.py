"""The saved state of unfinished fine-tuning, from which it resumes with bit-identical results."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from splatcore.model.formats.file import input_error, reading
from splatcore.model.gradients.trainable import Optimizers

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
        part = self.path.with_suffix(".part")
        with reading(self.path, "cannot be written"):
            torch.save(state, part)
            part.replace(self.path)

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
