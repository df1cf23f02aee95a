"""A packed model: its bytes in DRAM, and the Gaussians that they describe."""

import zlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatcore.spec import convention, memory
from splatcore.spec.colour import (
    BASE,
    CHANNELS,
    LAYOUTS,
    Harmonics,
    coefficient_count,
    from_slopes,
    step,
    unfolded,
)
from splatcore.spec.model_header import ModelHeader
from splatcore.spec.record import Record, unpack_bits
from splatcore.spec.scene import Gaussians
from splatcore.spec.small import expanded


def harmonics_beats(layouts: np.ndarray, count: int) -> np.ndarray:
    """Return the beats [N] of harmonics of each of `count` Gaussians; layouts: [C], of chunks."""
    beats = np.array([layout.beats for layout in LAYOUTS])[layouts]
    return np.repeat(beats, memory.CHUNK)[:count]


def offsets(stored: np.ndarray, octant_end: np.ndarray, bits: int) -> np.ndarray:
    """Return whole offsets [N, 3].

    stored: [N, 3] stored bits
    octant_end: [C, 7] from the chunk headers
    bits: number of stored bits
    """
    of, place = np.divmod(np.arange(len(stored)), memory.CHUNK)
    octant = (place[:, None] >= octant_end[of]).sum(1)  # [N]
    top = octant[:, None] >> np.arange(3) & 1
    return (stored.astype(np.int64) | top << bits) << memory.STORED_BITS - bits


def grid_points(offset: np.ndarray, origin: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return positions [N, 3] in grid steps, int64.

    offset: [N, 3] from the chunk's origin
    origin, shift: [C, 3] from the chunk headers
    """
    of = np.arange(len(offset)) // memory.CHUNK
    return origin[of] + (offset << shift[of].astype(np.int64))


@dataclass(frozen=True, eq=False)
class PackedModel(ModelHeader):
    """The image of a model in DRAM."""

    def __post_init__(self):
        """Raise InputError, naming the field, unless the header describes the image."""
        super().__post_init__()
        refuse, degree, codebooks = self.refuse, self.value("sh_degree"), self.format.codebooks
        if len(self.image) < self.layout_of(0).positions:
            refuse("count", f"{len(self)} needs chunk headers beyond the file's end")
        if codebooks and self.chunks["harmonics"].any():
            refuse("harmonics", "of a chunk do not go with codebooks")
        for k in np.unique(self.chunks["harmonics"]):
            if LAYOUTS[k].halves and LAYOUTS[k].degree > degree:
                refuse("harmonics", f"{k} of a chunk does not go with SH degree {degree}")
        expected = self.layout.end
        if len(self.image) != expected:
            refuse("count", f"{len(self)} needs {expected} bytes but there are {len(self.image)}")
        for part in memory.PLACED:
            if self.value(part) * memory.ALIGNMENT != getattr(self.layout, part):
                refuse(part, f"{self.value(part) * memory.ALIGNMENT} is not where this part begins")
        if self.value("checksum") != checksum(self.image):
            refuse("checksum", "is wrong: the file is damaged")

    @cached_property
    def layout(self) -> memory.Layout:
        """Byte offsets of the parts."""
        counts = np.full(len(self.chunk_beats), memory.CHUNK)
        counts[-1:] -= -len(self) % memory.CHUNK
        return self.layout_of(int(counts @ (self.chunk_beats - 1)))

    @cached_property
    def chunk_beats(self) -> np.ndarray:
        """Beats [C] of attributes per Gaussian of each chunk."""
        return 1 + np.array([layout.beats for layout in LAYOUTS])[self.chunks["harmonics"]]

    @cached_property
    def beats(self) -> np.ndarray:
        """First beat [N] of each Gaussian's attributes, counted from the model's first."""
        if self.format.small:
            return np.arange(len(self)) // 2
        beats = 1 + harmonics_beats(self.chunks["harmonics"], len(self))
        return np.cumsum(beats) - beats

    def attribute_bursts(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return first beats and lengths of the bursts that read the attributes of Gaussians.

        index: [M] ascending; neighbours in a small model may share a beat, and then a burst
        """
        if self.format.small:
            first = np.unique(index // 2)
            return first, np.ones_like(first)
        return self.beats[index], self.chunk_beats[index // memory.CHUNK]

    def _records(self, record: Record, start: int, count: int) -> dict[str, np.ndarray]:
        """Return the codes of `count` records at byte `start`."""
        part = self.image[start : start + count * record.size]
        return record.unpack(part.reshape(count, record.size))

    @cached_property
    def chunks(self) -> dict[str, np.ndarray]:
        """Values of the chunk headers: the fields of `spec.memory.CHUNK_HEADER`."""
        record, count = memory.CHUNK_HEADER, memory.chunk_count(len(self))
        return record.decode(self._records(record, self.layout_of(0).chunks, count))

    @property
    def stored_positions(self) -> np.ndarray:
        """Codes [N, 3] of the stored positions."""
        record, start = self.format.position_record, self.layout.positions
        width = record["x"].width
        return unpack_bits(self.image[start:], width, 3 * len(self)).reshape(-1, 3)

    @property
    def offsets(self) -> np.ndarray:
        """Offsets [N, 3] from the chunk's origin, for models with chunk positions."""
        ends, bits = self.chunks["octant_end"], self.format.stored_bits
        return offsets(self.stored_positions, ends, bits)

    def attribute_beats(self, index: np.ndarray) -> np.ndarray:
        """Return the beats [M, 16] of attributes with the given numbers, uint8."""
        part, size = self.image[self.layout.attributes :], memory.ATTRIBUTE_BITS // 8
        return part[: len(part) // size * size].reshape(-1, size)[index]

    @property
    def stored_attributes(self) -> np.ndarray:
        """Each Gaussian's first attributes as stored: uint8 [N, 16], in small models [N, 8]."""
        if not self.format.small:
            return self.attribute_beats(self.beats)
        size = self.format.stored_record.size
        return self.image[self.layout.attributes :][: len(self) * size].reshape(-1, size)

    @cached_property
    def attributes(self) -> dict[str, np.ndarray]:
        """Codes [N] of each Gaussian's first beat of attributes, by field."""
        codes = self.format.stored_record.unpack(self.stored_attributes)
        return expanded(codes) if self.format.small else codes

    @property
    def position(self) -> np.ndarray:
        """Positions [N, 3], scene units, exact in float64."""
        return np.ldexp(self.grid.astype(np.float64), self.value("position_exponent"))

    @cached_property
    def grid(self) -> np.ndarray:
        """Positions [N, 3] in grid steps, int64."""
        if self.format.position == "absolute":
            stored = self.format.position_record["x"].decode(self.stored_positions)
            return np.ldexp(stored, -self.value("position_exponent")).astype(np.int64)
        chunks = self.chunks
        return grid_points(self.offsets, chunks["origin"].astype(np.int64), chunks["shift"])

    @property
    def factor(self) -> np.ndarray:
        """L [N, 3, 3], scene units."""
        codes, record = self.attributes, self.format.attribute_record
        lower = np.zeros((len(self), 3, 3))
        for row, column in zip(*np.tril_indices(3), strict=True):
            field = f"l{row}{column}"
            lower[:, row, column] = record[field].decode(codes[field])
        return np.ldexp(lower, self.value("factor_exponent"))

    @property
    def opacity(self) -> np.ndarray:
        """Opacities [N]."""
        record = self.format.attribute_record
        return np.exp2(-record["opacity"].decode(self.attributes["opacity"]))

    @property
    def factors(self) -> list[np.ndarray]:
        """Factors [N, k, 3] of `spec.colour`'s polynomials, for each degree.

        Degree 0 is the colour without harmonics, minus ½.
        """
        if not self.format.codebooks:
            return self._steps()
        colour = self._codebook(0, self.layout.colours, memory.COLOUR_ENTRY, "rgb")
        found = [colour[:, None] - convention.COLOUR_OFFSET]
        if self.format.sh_degree:
            g = self._codebook(1, self.layout.sh, memory.SH_ENTRY, "g")
            found.append(from_slopes(g.reshape(-1, 3, 3)))
        return found

    def _steps(self) -> list[np.ndarray]:
        """Return the factors of a model in steps."""
        found = [
            np.zeros((len(self), coefficient_count(d), 3)) for d in range(self.format.sh_degree + 1)
        ]
        of = np.arange(len(self)) // memory.CHUNK
        steps = [step(s, e) for s, e in zip(self.chunks["step"].T, self.exponents, strict=True)]
        base = [BASE.decode(self.attributes[channel]) for channel in CHANNELS]
        found[0][:, 0] = np.stack(base, axis=1) * steps[0][of][:, None]
        for number, layout in enumerate(LAYOUTS):
            index = np.flatnonzero(self.chunks["harmonics"][of] == number)
            codes, shifts = self.harmonics(index, layout)
            for d in range(1, min(layout.degree, self.format.sh_degree) + 1):
                own = np.ldexp(steps[d][of[index]], -shifts[d])
                found[d][index] = (codes[d] + layout.halves / 2) * own[:, None, None]
        return found

    def harmonics(
        self, index: np.ndarray, layout: Harmonics
    ) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
        """Return codes [M, k, 3] and shifts [M] of each degree from 1 on.

        index: [M] Gaussians of chunks with this layout
        layout: one of `LAYOUTS`
        """
        beats = [
            record.unpack(self.attribute_beats(self.beats[index] + 1 + k))
            for k, record in enumerate(layout.records)
        ]
        fields = {name: codes for beat in beats for name, codes in beat.items()}
        codes: dict[int, list] = {}
        for number, term in layout.terms:
            format = layout.format(term.degree)
            of_term = [format.decode(fields[f"{c}_{number}"]).astype(np.int64) for c in CHANNELS]
            codes.setdefault(term.degree, []).append(np.stack(of_term, axis=2))
        shifts = {d: fields[f"shift{d}"].astype(np.int64) for d in codes}
        return {d: np.concatenate(parts, axis=1) for d, parts in codes.items()}, shifts

    def _codebook(self, degree: int, start: int, entry: Record, field: str) -> np.ndarray:
        """Return the sums [N, D] of the codebook entries chosen by the attributes' indices."""
        part, stages = (
            ("sh", self.format.sh_index) if degree else ("colour", self.format.colour_index)
        )
        table = self._records(entry, start, sum(1 << bits for bits in stages))[field]
        values = entry[field].decode(table)
        total, base = np.zeros((len(self), values.shape[1])), 0
        for stage, bits in enumerate(stages):
            total += values[base + self.attributes[f"{part}{stage}"].astype(np.int64)]
            base += 1 << bits
        return np.ldexp(total, self.exponents[degree])

    @property
    def sh(self) -> np.ndarray:
        """Coefficients [N, (degree+1)², 3] in the order of 3DGS."""
        return unfolded(self.factors)

    def gaussians(self) -> Gaussians:
        """Return the Gaussians exactly as the hardware reads them."""
        return Gaussians(self.position, self.factor, self.opacity, self.sh, self.antialiased)

    @property
    def bytes_per_gaussian(self) -> float:
        """Bytes per Gaussian of the whole model except its codebooks."""
        return (len(self.image) - self.format.codebook_bytes) / max(len(self), 1)


def checksum(image: np.ndarray) -> int:
    """Return the CRC-32 of everything except the checksum itself."""
    place = memory.HEADER.offset("checksum") // 8
    start = zlib.crc32(image[:place].tobytes())
    return zlib.crc32(image[place + memory.HEADER["checksum"].width // 8 :].tobytes(), start)
