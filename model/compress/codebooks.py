"""Fine-tuning of colours in codebooks.

The entries are optimised on their grid. Each Gaussian also keeps harmonics of its own, which learn
by the same gradients (a straight-through estimator; van den Oord et al. 2017). From time to time it
is assigned the entries nearest to them, as seen from the views.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from sklearn.metrics import pairwise_distances_argmin

from splatcore.model.compress.quantize import Quantised, round_fixed
from splatcore.model.compress.significance import Directions
from splatcore.model.gradients.trainable import RATES, Tensors, tensors_of
from splatcore.model.pack.codebook import Codebook, quantise
from splatcore.model.pack.pack import appearance
from splatcore.model.pack.quality import COMPACT
from splatcore.model.pack.stored import Stored
from splatcore.spec.colour import SH_C0, SH_C1, SH_EXPONENT_MAX
from splatcore.spec.config import Config
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.memory import COMPONENT, SLOPE, model_format
from splatcore.spec.number import Fixed
from splatcore.spec.scene import Scene

CODEBOOK_RATE = RATES["sh0"] * SH_C0
"""Learning rate of the codebooks' entries: the rate of sh0, converted to units of colour."""


Nearest = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function of vectors [N, D] and entries [K, D]: the index [N] of the nearest entry of each."""


@dataclass(eq=False)
class Stages:
    """A codebook whose entries are optimised: one tensor [2^bits, D] per stage, in real units."""

    format: Fixed
    exponent: int
    entries: list[torch.Tensor]
    index: list[torch.Tensor]

    @staticmethod
    def of(codebook: Codebook, format: Fixed, like: torch.Tensor) -> "Stages":
        values = [np.ldexp(entries, codebook.exponent) for entries in codebook.entries]
        entries = [like.new_tensor(each).requires_grad_() for each in values]
        index = [torch.as_tensor(index, device=like.device) for index in codebook.index]
        return Stages(format, codebook.exponent, entries, index)

    def rounded(self) -> list[torch.Tensor]:
        """The entries on their grid, in real units."""
        unit = 2.0**self.exponent
        return [round_fixed(values / unit, self.format) * unit for values in self.entries]

    def decode(self) -> torch.Tensor:
        """The vectors [N, D]."""
        stages = zip(self.rounded(), self.index, strict=True)
        return sum(values.index_select(0, index) for values, index in stages)

    def assign(self, vectors: np.ndarray, nearest: Nearest) -> np.ndarray:
        """Assign the nearest entry to each of the vectors [N, D], stage by stage; return the
        remaining errors [N, D]."""
        rest = vectors
        for index, entries in zip(self.index, self.rounded(), strict=True):
            values = entries.detach().double().cpu().numpy()
            found = nearest(rest, values)
            index[:] = torch.as_tensor(found)
            rest = rest - values[found]
        return rest

    def codebook(self) -> Codebook:
        """The codebook as the model stores it."""
        unit = 2.0**self.exponent
        values = [entries.detach().double().cpu().numpy() for entries in self.rounded()]
        entries = [np.rint(each / unit) for each in values]
        return Codebook(self.exponent, entries, [index.cpu().numpy() for index in self.index])


@dataclass(eq=False)
class InCodebooks(Quantised):
    """A scene of degree 0 or 1, quantised to a model in codebooks (small or compact)."""

    colour: Stages
    harmonics: Stages
    seen: Directions

    def refresh_colours(self, scene: Scene, stored: Stored):
        """Assign to each Gaussian the entries nearest to its own harmonics, as seen from the
        views."""
        colours = assign_slopes(self.harmonics, scene, self.seen)
        self.colour.assign(colours, pairwise_distances_argmin)

    def taken(self) -> list[torch.Tensor]:
        return super().taken() + self.colour.index + self.harmonics.index

    def harmonics_of(self, tensors: Tensors) -> torch.Tensor:
        """Harmonics from the entries; gradients go to the entries and to the Gaussian's own."""
        sh = [((self.colour.decode() - COLOUR_OFFSET) / SH_C0)[:, None]]
        if self.harmonics.entries:
            x, y, z = self.harmonics.decode().reshape(-1, 3, 3).unbind(2)
            sh.append(torch.stack([-y, z, -x], dim=1) / SH_C1)
        own = torch.cat([tensors["sh0"], tensors["shN"]], dim=1)
        return torch.cat(sh, dim=1) + (own - own.detach())

    def leaves(self) -> tuple[Tensors, dict[str, float]]:
        entries = {
            f"{part}{stage}": values
            for part, stages in (("colour", self.colour), ("harmonics", self.harmonics))
            for stage, values in enumerate(stages.entries)
        }
        return self.tensors | entries, dict.fromkeys(entries, CODEBOOK_RATE)

    def codebooks(self) -> tuple[Codebook, Codebook]:
        return self.colour.codebook(), self.harmonics.codebook()


def in_codebooks(
    scene: Scene,
    weight: np.ndarray,
    seen: Directions,
    config: Config,
    seed: int,
    quality: str = COMPACT,
) -> InCodebooks:
    """Quantise a scene of degree 0 or 1 with codebooks by k-means.

    weight: [N] significance of each Gaussian
    seen: directions from which the views look at each Gaussian
    quality: of `INDEXED`
    """
    format = model_format(config, scene.sh_degree)
    weight = np.maximum(weight, np.finfo(np.float32).tiny)
    tensors, (_, slopes) = tensors_of(scene), appearance(scene.sh.astype(np.float64))
    like = tensors["means"].detach()
    of_slopes = weight if len(slopes) else None
    found = quantise(slopes, format.sh_index, SLOPE, seed, of_slopes, SH_EXPONENT_MAX)
    harmonics = Stages.of(found, SLOPE, like)
    colours = assign_slopes(harmonics, scene, seen)
    found = quantise(colours, format.colour_index, COMPONENT, seed, weight)
    colour = Stages.of(found, COMPONENT, like)
    return InCodebooks(tensors, config, quality, colour, harmonics, seen)


def assign_slopes(harmonics: Stages, scene: Scene, seen: Directions) -> np.ndarray:
    """Assign the nearest slopes to each Gaussian; return colours [N, 3] that compensate for the
    error of the slopes."""
    colours, slopes = appearance(scene.sh.astype(np.float64))
    if not harmonics.entries:
        return colours
    return seen.compensated(colours, harmonics.assign(slopes, seen.nearest))
