"""Quantisation: the packed model's numbers, and fine-tuning under them.

Every step renders what the machine would read: codebook entries on their grid, opacity as rounded
attenuation, L as rounded floats, positions on the chunks' grids. Gradients pass the rounding
unchanged (straight-through estimator; Bengio et al. 2013) and reach the codebooks through the
assignment of the Gaussians to their entries.
"""

from dataclasses import dataclass, field

import numpy as np
import torch

from splatcore.model.gradients.trainable import RATES, Tensors, rotation, scene_of, tensors_of
from splatcore.model.pack.chunk import chunk_positions
from splatcore.model.pack.codebook import Codebook, quantise
from splatcore.model.pack.pack import Codebooks, appearance, largest_factor
from splatcore.spec.colour import SH_C0, SH_C1, SH_EXPONENT_MAX
from splatcore.spec.config import Config
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.memory import ABSOLUTE, COMPONENT, FACTOR, OPACITY, SLOPE, model_format
from splatcore.spec.number import Fixed, Float
from splatcore.spec.packed import grid_points, offsets
from splatcore.spec.scene import Scene

REFRESH = 50  # steps after which the chunks' grids and L's unit are taken anew: they move little

CODEBOOK_RATE = RATES["sh0"] * SH_C0
"""Learning rate of the codebooks' entries, which are colours: that of sh0 in units of colour."""


def straight(value: torch.Tensor, rounded: torch.Tensor) -> torch.Tensor:
    """`rounded` forwards, the gradient of `value` backwards."""
    return value + (rounded - value).detach()


def round_fixed(value: torch.Tensor, format: Fixed) -> torch.Tensor:
    """`format.round` as an operation of torch."""
    steps = torch.round(value / format.step) * format.step
    return straight(value, steps.clamp(format.min, format.max))


def round_float(value: torch.Tensor, format: Float) -> torch.Tensor:
    """`format.round` of finite values, subnormal ones included, as an operation of torch."""
    with torch.no_grad():
        _, exponent = torch.frexp(value)  # value = mantissa·2^exponent with ½ ≤ |mantissa| < 1
        smallest = torch.tensor(format.min_normal).frexp().exponent
        step = torch.ldexp(
            torch.ones_like(value), exponent.clamp(min=int(smallest)) - 1 - format.fraction
        )
        rounded = (torch.round(value / step) * step).clamp(-format.max, format.max)
    return straight(value, rounded)


def lower_factor(tensors: Tensors) -> torch.Tensor:
    """L [N, 3, 3] of the Gaussians: row by row Gram–Schmidt on R·S.

    The last diagonal element is the product of the scales over those of the others: exact for
    flakes, whose thickness a difference would lose.
    """
    scale = torch.exp(tensors["scales"])
    first, second, third = (rotation(tensors["quats"]) * scale[:, None]).unbind(1)
    l00 = first.norm(dim=1)
    along = first / l00[:, None]
    l10, l20 = (second * along).sum(1), (third * along).sum(1)
    normal = torch.linalg.cross(first, second)
    area = normal.norm(dim=1)  # = l00·l11
    across = torch.linalg.cross(normal / area[:, None], along)
    l21 = (third * across).sum(1)
    zero = torch.zeros_like(l00)
    rows = [l00, zero, zero, l10, area / l00, zero, l20, l21, scale.prod(1) / area]
    return torch.stack(rows, dim=1).reshape(-1, 3, 3)


@dataclass(eq=False)
class Stages:
    """A codebook whose entries are optimised: one tensor [2^bits, D] a stage, in real units."""

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

    def codebook(self) -> Codebook:
        """The codebook as the model stores it."""
        unit = 2.0**self.exponent
        values = [entries.detach().double().cpu().numpy() for entries in self.rounded()]
        entries = [np.rint(each / unit) for each in values]
        return Codebook(self.exponent, entries, [index.cpu().numpy() for index in self.index])


@dataclass(eq=False)
class Quantised:
    """A scene of degree 0 or 1 under the numbers of a machine's packed model."""

    tensors: Tensors
    config: Config
    colour: Stages
    harmonics: Stages
    position_error: torch.Tensor = field(init=False)  # [N, 3] stored − optimised, scene units
    factor_exponent: int = field(init=False)

    def __post_init__(self):
        self.refresh()

    @torch.no_grad()
    def refresh(self):
        """Take the chunks' grids and L's unit from the parameters as they are."""
        means = self.tensors["means"].detach()
        position = means.double().cpu().numpy()
        if self.config.position == "absolute":
            stored = ABSOLUTE.round(position)
        else:
            stored = stored_positions(position)
        self.position_error = means.new_tensor(stored - position)
        largest = float(lower_factor(self.tensors).abs().max())
        self.factor_exponent = int(np.frexp(largest / largest_factor(self.config.arithmetic))[1])

    def rendered(self, tensors: Tensors) -> tuple[torch.Tensor, ...]:
        """Position, L, opacity and harmonics as the machine reads them."""
        position = tensors["means"] + self.position_error
        unit = 2.0**self.factor_exponent
        factor = round_float(lower_factor(tensors) / unit, FACTOR) * unit
        opacity = torch.sigmoid(tensors["opacities"])
        opacity = torch.exp2(-round_fixed(-torch.log2(opacity), OPACITY))
        sh = [((self.colour.decode() - COLOUR_OFFSET) / SH_C0)[:, None]]
        if self.harmonics.entries:
            x, y, z = self.harmonics.decode().reshape(-1, 3, 3).unbind(2)
            sh.append(torch.stack([-y, z, -x], dim=1) / SH_C1)
        return position, factor, opacity, torch.cat(sh, dim=1)

    def leaves(self) -> tuple[Tensors, dict[str, float]]:
        """Optimised tensors by name, and learning rates of those that only this file knows."""
        found = {name: self.tensors[name] for name in ("means", "scales", "quats", "opacities")}
        entries = {
            f"{part}{stage}": values
            for part, stages in (("colour", self.colour), ("harmonics", self.harmonics))
            for stage, values in enumerate(stages.entries)
        }
        return found | entries, dict.fromkeys(entries, CODEBOOK_RATE)

    def finish(self, name: str) -> tuple[Scene, Codebooks]:
        """The scene to pack, and its codebooks."""
        colour, harmonics = self.colour.codebook(), self.harmonics.codebook()
        with torch.no_grad():
            sh = self.rendered(self.tensors)[3]
        whole = self.tensors | {"sh0": sh[:, :1], "shN": sh[:, 1:]}
        return scene_of(whole, name), (colour, harmonics)


def quantised(scene: Scene, weight: np.ndarray, config: Config, seed: int) -> Quantised:
    """A scene of degree 0 or 1 with codebooks by k-means weighted by significance [N]."""
    format = model_format(config, scene.sh_degree)
    colours, slopes = appearance(scene)
    weight = np.maximum(weight, np.finfo(np.float32).tiny)
    tensors = tensors_of(scene)
    like = tensors["means"].detach()
    colour = quantise(colours, format.colour_index, COMPONENT, seed, weight)
    of_slopes = weight if len(slopes) else None
    harmonics = quantise(slopes, format.sh_index, SLOPE, seed, of_slopes, SH_EXPONENT_MAX)
    stages = Stages.of(colour, COMPONENT, like), Stages.of(harmonics, SLOPE, like)
    return Quantised(tensors, config, *stages)


def stored_positions(position: np.ndarray) -> np.ndarray:
    """Positions [N, 3] as a packed model stores them, in the order in which they are given."""
    chunks = chunk_positions(position)
    grid = grid_points(offsets(chunks.stored, chunks.octant_end), chunks.origin, chunks.shift)
    stored = np.empty_like(position)
    stored[chunks.order] = np.ldexp(grid.astype(np.float64), chunks.exponent)
    return stored
