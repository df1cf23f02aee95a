"""Gaussians of a packed model, decoded from its bytes: all of them or a few."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from splatcore.spec import convention, memory
from splatcore.spec.colour import (
    BASE,
    CHANNELS,
    LAYOUTS,
    coefficient_count,
    from_slopes,
    step,
    unfolded,
)
from splatcore.spec.number import Fixed, Float, code_dtype
from splatcore.spec.small import expanded

if TYPE_CHECKING:
    from splatcore.spec.packed import PackedModel


def offsets(
    stored: np.ndarray, octant_end: np.ndarray, bits: int, index: np.ndarray | None = None
) -> np.ndarray:
    """Return whole offsets [N, 3].

    stored: [N, 3] stored bits
    octant_end: [C, 7] from the chunk headers
    bits: number of stored bits
    index: [N] the Gaussians; None: the first N
    """
    of, place = np.divmod(np.arange(len(stored)) if index is None else index, memory.CHUNK)
    ends = octant_end.astype(np.int64).T
    octant = sum((place >= end[of]).astype(np.int64) for end in ends)  # [N]
    top = octant[:, None] >> np.arange(3) & 1
    return (stored.astype(np.int64) | top << bits) << memory.STORED_BITS - bits


def grid_points(
    offset: np.ndarray, origin: np.ndarray, shift: np.ndarray, index: np.ndarray | None = None
) -> np.ndarray:
    """Return positions [N, 3] in grid steps, int64.

    offset: [N, 3] from the chunk's origin
    origin, shift: [C, 3] from the chunk headers
    index: [N] the Gaussians; None: the first N
    """
    of = (np.arange(len(offset)) if index is None else index) // memory.CHUNK
    return origin[of] + (offset << shift[of].astype(np.int64))


@cache
def values_of(format: Fixed | Float) -> np.ndarray:
    """Return the values of all codes of a format of at most 16 bits."""
    return format.decode(np.arange(1 << format.width))


@dataclass(frozen=True, eq=False)
class Decoded:
    """Some Gaussians of a packed model; each property decodes them again.

    index: [N] their numbers
    """

    model: "PackedModel"
    index: np.ndarray

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, index) -> "Decoded":
        """Return the Gaussians that a numpy index (slice, mask or integers) selects."""
        return Decoded(self.model, self.index[index])

    decoded = __getitem__

    @property
    def antialiased(self) -> bool:
        """Whether opacities must be compensated for the blur."""
        return self.model.antialiased

    @property
    def finite(self) -> np.ndarray:
        """Whether all numbers of a Gaussian are finite [N]: all codes have finite values."""
        return np.ones(len(self), bool)

    @property
    def stored_positions(self) -> np.ndarray:
        """Codes [N, 3] of the stored positions."""
        image, record = self.model.image, self.model.format.position_record
        width, bits = record["x"].width, self.index * record.width
        # Positions of at most 57 bits are in the 8 bytes from their first byte on; the attributes
        # follow them in the image.
        rest = max(len(image) - 8 - self.model.layout.positions + 1, 0)
        words = np.ndarray(rest, "<u8", image, self.model.layout.positions, 1)[bits >> 3]
        words >>= (bits & 7).astype(np.uint64)
        codes = np.empty((len(self), 3), code_dtype(width))
        for axis in range(3):
            codes[:, axis] = words >> np.uint64(axis * width) & np.uint64((1 << width) - 1)
        return codes

    @property
    def grid(self) -> np.ndarray:
        """Positions [N, 3] in grid steps, int64."""
        model, chunks, codes = self.model, self.model.chunks, self.stored_positions
        if model.format.position == "absolute":
            stored = model.format.position_record["x"].decode(codes)
            return np.ldexp(stored, -model.value("position_exponent")).astype(np.int64)
        offset = offsets(codes, chunks["octant_end"], model.format.stored_bits, self.index)
        return grid_points(offset, chunks["origin"].astype(np.int64), chunks["shift"], self.index)

    @property
    def position(self) -> np.ndarray:
        """Positions [N, 3], scene units, exact in float64."""
        return np.ldexp(self.grid.astype(np.float64), self.model.value("position_exponent"))

    @property
    def stored_attributes(self) -> np.ndarray:
        """Each Gaussian's first attributes as stored: uint8 [N, 16], in small models [N, 8]."""
        model = self.model
        if not model.format.small:
            return model.attribute_beats(model.first_beats(self.index))
        size = model.format.stored_record.size
        stored = model.image[model.layout.attributes :][: model.count * size]
        return stored.reshape(-1, size)[self.index]

    @cached_property
    def attributes(self) -> dict[str, np.ndarray]:
        """Codes [N] of each Gaussian's first beat of attributes, by field."""
        codes = self.model.format.stored_record.unpack(self.stored_attributes)
        return expanded(codes) if self.model.format.small else codes

    @property
    def factor(self) -> np.ndarray:
        """L [N, 3, 3], scene units."""
        codes, record = self.attributes, self.model.format.attribute_record
        lower = np.zeros((len(self), 3, 3))
        for row, column in zip(*np.tril_indices(3), strict=True):
            field = f"l{row}{column}"
            unit = np.ldexp(values_of(record[field]), self.model.value("factor_exponent"))
            lower[:, row, column] = unit[codes[field]]
        return lower

    @property
    def opacity(self) -> np.ndarray:
        """Opacities [N]."""
        format = self.model.format.attribute_record["opacity"]
        return np.exp2(-values_of(format))[self.attributes["opacity"]]

    @property
    def factors(self) -> list[np.ndarray]:
        """Factors [N, k, 3] of `spec.colour`'s polynomials, for each degree.

        Degree 0 is the colour without harmonics, minus ½.
        """
        if not self.model.format.codebooks:
            return self._steps()
        found = [self._codebook(0)[:, None] - convention.COLOUR_OFFSET]
        if self.model.format.sh_degree:
            found.append(from_slopes(self._codebook(1).reshape(-1, 3, 3)))
        return found

    def _steps(self) -> list[np.ndarray]:
        """Return the factors of a model in steps."""
        model, of = self.model, self.index // memory.CHUNK
        degree, headers = model.format.sh_degree, model.chunks
        found = [np.zeros((len(self), coefficient_count(d), 3)) for d in range(degree + 1)]
        steps = [step(s, e) for s, e in zip(headers["step"].T, model.exponents, strict=True)]
        base = [BASE.decode(self.attributes[channel]) for channel in CHANNELS]
        found[0][:, 0] = np.stack(base, axis=1) * steps[0][of][:, None]
        for number, layout in enumerate(LAYOUTS):
            own = np.flatnonzero(headers["harmonics"][of] == number)
            codes, shifts = model.harmonics(self.index[own], layout)
            for d in range(1, min(layout.degree, degree) + 1):
                unit = np.ldexp(steps[d][of[own]], -shifts[d])
                found[d][own] = (codes[d] + layout.halves / 2) * unit[:, None, None]
        return found

    def _codebook(self, degree: int) -> np.ndarray:
        """Return the sums [N, D] of the codebook entries chosen by the attributes' indices."""
        part, stages, values = self.model.codebook(degree)
        total, base = np.zeros((len(self), values.shape[1])), 0
        for stage, bits in enumerate(stages):
            total += values[base + self.attributes[f"{part}{stage}"].astype(np.int64)]
            base += 1 << bits
        return np.ldexp(total, self.model.exponents[degree])

    @property
    def sh(self) -> np.ndarray:
        """Coefficients [N, (degree+1)², 3] in the order of 3DGS."""
        return unfolded(self.factors)
