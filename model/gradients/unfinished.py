"""Fine-tuning that is not finished: a file from which it goes on, to the same bits."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from splatcore.model.formats.file import input_error, reading
from splatcore.model.gradients.trainable import Optimizers

KEEP_EVERY = 100
"""Steps between two states that are kept: three minutes of flowers at full HD."""


@dataclass(frozen=True)
class Unfinished:
    """Where a fine-tuning keeps its state; `more` are tensors beside the optimised ones that change
    as it goes. Learning rates are not kept: `optimise` knows them."""

    path: Path
    more: Callable[[], list[torch.Tensor]] = list

    def save(self, optimizers: Optimizers, step: int, loss: float):
        """Keep everything from which it goes on after `step` steps; `loss`: the mean one lately."""
        state = {
            "step": step, "loss": loss, "tensors": self.tensors(optimizers),
            "moments": {name: each.state_dict()["state"] for name, each in optimizers.items()},
        }  # fmt: skip
        part = self.path.with_suffix(".part")
        with reading(self.path, "cannot be written"):
            torch.save(state, part)
            part.replace(self.path)

    def load(self, optimizers: Optimizers) -> tuple[int, float | None]:
        """Go on from what is kept: steps that are done (0 if nothing is kept) and their mean loss.
        InputError if the file is broken."""
        if not self.path.exists():
            return 0, None
        with reading(self.path, "is not a state of this fine-tuning; remove it"):
            state = torch.load(self.path, weights_only=True)
            tensors = self.tensors(optimizers)
            if [each.shape for each in state["tensors"]] != [each.shape for each in tensors]:
                raise input_error(self.path, "is of another fine-tuning; remove it")
            for name, optimizer in optimizers.items():
                groups = optimizer.state_dict()["param_groups"]
                moments = state["moments"][name]
                optimizer.load_state_dict({"state": moments, "param_groups": groups})
            for tensor, kept in zip(tensors, state["tensors"], strict=True):
                tensor.copy_(kept)
            return state["step"], state["loss"]

    def tensors(self, optimizers: Optimizers) -> list[torch.Tensor]:
        """All tensors that steps change, those of the optimizers first."""
        groups = [group for each in optimizers.values() for group in each.param_groups]
        learned = [tensor.detach() for group in groups for tensor in group["params"]]
        return learned + self.more()
