"""Fine-tuning of colours in steps: each harmonic coefficient is rendered as the multiple of its
step, chosen per chunk and Gaussian, that the model stores (`spec.colour`)."""

from dataclasses import dataclass, field

import numpy as np
import torch

from splatcore.model.compress.quantize import Quantised, straight
from splatcore.model.gradients.trainable import Tensors
from splatcore.model.pack.pack import layouts
from splatcore.model.pack.steps import Steps, largest_factors, quantise_steps, step_exponents
from splatcore.model.pack.stored import Stored
from splatcore.spec.colour import BASE, FOLDED, LAYOUTS, folded, step
from splatcore.spec.memory import CHUNK
from splatcore.spec.scene import Scene, sh_count


@dataclass(frozen=True, eq=False)
class Grid:
    """Steps and range of codes for all coefficients of a degree; float64 [N, 1, 1]."""

    size: torch.Tensor  # step
    least: torch.Tensor  # smallest code
    most: torch.Tensor  # largest code
    half: torch.Tensor  # ½ where code k represents k + ½ steps

    def round(self, factors: torch.Tensor) -> torch.Tensor:
        """Factors [N, k, 3] rounded as the model stores them."""
        steps = factors / self.size
        codes = torch.where(self.half > 0, torch.floor(steps), torch.round(steps))
        return (codes.clamp(self.least, self.most) + self.half) * self.size


@dataclass(eq=False)
class InSteps(Quantised):
    """A scene of any degree, rendered with the number formats of a model in steps."""

    grids: list[Grid] = field(init=False, default_factory=list)  # one per degree

    def refresh_colours(self, scene: Scene, stored: Stored):
        """Choose the steps as packing will: at first for the scene, later for the rounded
        coefficients. Learned coefficients are near the middle between two codes, and other steps
        would round them differently."""
        factors = folded((self.as_read() if self.grids else scene).sh[stored.index])
        largest = largest_factors(factors)
        harmonics = layouts(largest, self.quality)
        steps = quantise_steps(factors, harmonics, step_exponents(largest, harmonics))
        device = self.tensors["means"].device
        self.grids = [
            Grid(*(torch.tensor(numbers, device=device) for numbers in grid))
            for grid in grids(steps, len(factors), stored, len(scene))
        ]

    def taken(self) -> list[torch.Tensor]:
        return super().taken() + [each for grid in self.grids for each in vars(grid).values()]

    def harmonics_of(self, tensors: Tensors) -> torch.Tensor:
        """Harmonics rounded in float64, as packing does."""
        sh = torch.cat([tensors["sh0"], tensors["shN"]], dim=1)
        found = []
        for degree, grid in enumerate(self.grids):
            constants = sh.new_tensor(FOLDED[degree], dtype=torch.float64)[:, None]
            own = sh[:, degree**2 : sh_count(degree)].double()
            found.append(straight(own, grid.round(own.detach() * constants) / constants))
        return torch.cat(found, dim=1).to(sh.dtype)


def grids(steps: Steps, degrees: int, stored: Stored, count: int) -> list[np.ndarray]:
    """The fields of `Grid`, [4, N, 1, 1], for each degree and N = `count` Gaussians.

    Gaussians that are not in `stored` [M] have steps of 1 and code 0 only.
    """
    of, own = np.arange(len(stored.index)) // CHUNK, ~stored.chunks.padding
    found = []
    for degree in range(degrees):
        grid = np.zeros((4, count, 1, 1))
        grid[0] = 1
        sizes = step(steps.s[of, degree], steps.exponents[degree])
        if degree:
            sizes = np.ldexp(sizes, -steps.shifts[degree - 1])
        for number in np.unique(steps.harmonics):
            layout, which = LAYOUTS[number], own & (steps.harmonics[of] == number)
            if degree > layout.degree:
                continue
            code = layout.format(degree) if degree else BASE
            half = layout.halves / 2 if degree else 0
            values = np.broadcast_arrays(sizes[which], code.min, code.max, half)
            grid[:, stored.index[which], 0, 0] = values
        found.append(grid)
    return found
