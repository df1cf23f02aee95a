"""Quantisation-aware fine-tuning: a scene is rendered with the packed model's number formats.

Every step renders the numbers that the machine would read: opacity as rounded attenuation, L as
rounded floats, positions on the chunks' grids, colours in codebooks (`codebooks.py`) or in steps
(`steps.py`). Rounding passes gradients unchanged (straight-through estimator, Bengio et al. 2013).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from math import isqrt

import numpy as np
import torch

from splatcore.model.gradients.trainable import Tensors, rotation, scene_of
from splatcore.model.pack.chunk import Chunks
from splatcore.model.pack.codebook import Codebook
from splatcore.model.pack.pack import factor_exponent, format_of, pack
from splatcore.model.pack.stored import Stored, stored_scene
from splatcore.spec.config import Config
from splatcore.spec.decoded import grid_points, offsets
from splatcore.spec.memory import ABSOLUTE, FACTOR, ModelFormat
from splatcore.spec.number import Fixed, Float
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from splatcore.spec.small import EXPONENT_LAST, LARGEST, UNIT

REFRESH = 50
"""Steps between updates of the chunks, their grids and L's unit, which change slowly."""


def straight(value: torch.Tensor, rounded: torch.Tensor) -> torch.Tensor:
    """`rounded` in the forward pass, the gradient of `value` in the backward pass."""
    return value + (rounded - value).detach()


def round_fixed(value: torch.Tensor, format: Fixed) -> torch.Tensor:
    """`format.round` as a torch operation."""
    steps = torch.round(value / format.step) * format.step
    return straight(value, steps.clamp(format.min, format.max))


def round_float(value: torch.Tensor, format: Float) -> torch.Tensor:
    """`format.round` of finite values, subnormal ones included, as a torch operation."""
    with torch.no_grad():
        _, exponent = torch.frexp(value)  # value = mantissa·2^exponent with ½ ≤ |mantissa| < 1
        smallest = torch.tensor(format.min_normal).frexp().exponent
        step = torch.ldexp(
            torch.ones_like(value), exponent.clamp(min=int(smallest)) - 1 - format.fraction
        )
        rounded = (torch.round(value / step) * step).clamp(-format.max, format.max)
    return straight(value, rounded)


def round_shared(lower: torch.Tensor) -> torch.Tensor:
    """`spec.small.rounded_factor` as a torch operation."""
    with torch.no_grad():
        exponent = torch.frexp(lower.abs().amax((1, 2)) / (LARGEST + 0.5)).exponent
        step = torch.exp2(exponent.clamp(UNIT, EXPONENT_LAST + UNIT).to(lower))[:, None, None]
        rounded = torch.round(lower / step).clamp(-LARGEST, LARGEST) * step
    return straight(lower, rounded)


def lower_factor(tensors: Tensors) -> torch.Tensor:
    """L [N, 3, 3] of the Gaussians, by Gram–Schmidt on the rows of R·S.

    The last diagonal element is the product of the scales divided by the other two elements: exact
    for flakes, whose thickness would be lost in a difference.
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
class Quantised(ABC):
    """A scene that is rendered with the number formats of a machine's packed model."""

    tensors: Tensors
    config: Config
    quality: str  # of `QUALITIES`
    format: ModelFormat = field(init=False)
    position_error: torch.Tensor = field(init=False)  # [N, 3] stored − optimised, scene units
    stored: torch.Tensor = field(init=False)  # [N] 1, and 0 for Gaussians that packing drops
    unit: torch.Tensor = field(init=False)  # unit of L, scene units

    def __post_init__(self):
        degree = isqrt(1 + self.tensors["shN"].shape[1]) - 1
        self.format = format_of(self.config, self.quality, degree)
        self.refresh()

    @torch.no_grad()
    def refresh(self):
        """Recompute chunks, stored positions, L's unit and the colours' grids from the current
        parameters."""
        scene, means = scene_of(self.tensors), self.tensors["means"].detach()
        stored = stored_scene(scene, self.format)
        position = scene.position.copy()
        if self.config.position == "absolute":
            position = ABSOLUTE.round(position)
        else:
            own = ~stored.chunks.padding
            position[stored.index[own]] = stored_positions(stored.chunks)[own]
        self.position_error = means.new_tensor(position - scene.position)
        self.stored = means.new_tensor(np.isin(np.arange(len(scene)), stored.index))
        largest = float(lower_factor(self.tensors).abs().max())
        exponent = factor_exponent(self.config, self.format, largest)
        self.unit = means.new_tensor(2.0**exponent)
        self.refresh_colours(scene, stored)

    def taken(self) -> list[torch.Tensor]:
        """The tensors that `refresh` computes; with the leaves they determine the picture."""
        return [self.position_error, self.stored, self.unit]

    def rendered(self, tensors: Tensors) -> tuple[torch.Tensor, ...]:
        """Position, L, opacity and harmonics as the machine reads them."""
        position = tensors["means"] + self.position_error
        factor = lower_factor(tensors) / self.unit
        factor = round_shared(factor) if self.format.small else round_float(factor, FACTOR)
        factor = factor * self.unit
        opacity = torch.sigmoid(tensors["opacities"])
        steps = self.format.stored_record["opacity"]
        opacity = torch.exp2(-round_fixed(-torch.log2(opacity), steps)) * self.stored
        return position, factor, opacity, self.harmonics_of(tensors)

    def as_read(self, of: Scene | None = None) -> Scene:
        """The current scene, with harmonics as the machine reads them; `of`: as for `scene_of`."""
        with torch.no_grad():
            sh = self.harmonics_of(self.tensors)
        return scene_of(self.tensors | {"sh0": sh[:, :1], "shN": sh[:, 1:]}, of)

    @abstractmethod
    def refresh_colours(self, scene: Scene, stored: Stored):
        """Recompute the colours' grids or entries; `stored`: the scene's Gaussians in stored
        order."""

    @abstractmethod
    def harmonics_of(self, tensors: Tensors) -> torch.Tensor:
        """Harmonics [N, (degree+1)², 3] as the machine reads them."""

    def leaves(self) -> tuple[Tensors, dict[str, float]]:
        """Optimised tensors by name, and learning rates of tensors unknown to `trainable`."""
        return self.tensors, {}

    def codebooks(self) -> tuple[Codebook, Codebook] | None:
        """The codebooks of colours and of harmonics, if the model has any."""
        return None

    def packed(self, of: Scene | None = None) -> PackedModel:
        """The packed model of the current parameters, with the mark of the scene `of`."""
        scene, books = self.as_read(of), self.codebooks()
        return pack(scene, self.config, scene.sh_degree, None, books, self.quality)[0]


def stored_positions(chunks: Chunks) -> np.ndarray:
    """Positions [N, 3] of a packed model in these chunks, in stored order, scene units."""
    whole = offsets(chunks.stored, chunks.octant_end, chunks.bits)
    grid = grid_points(whole, chunks.origin, chunks.shift)
    return np.ldexp(grid.astype(np.float64), chunks.exponent)
