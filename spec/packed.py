"""A packed model: its bytes in DRAM, and the Gaussians that they describe."""

import zlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatcore.spec import memory
from splatcore.spec.colour import CHANNELS, LAYOUTS, Harmonics
from splatcore.spec.decoded import Decoded
from splatcore.spec.levels import LEVEL, Levels, fault
from splatcore.spec.model_header import ModelHeader
from splatcore.spec.record import Record
from splatcore.spec.scene import Gaussians, Scene, batches, sh_count

LAYOUT_BEATS = np.array([layout.beats for layout in LAYOUTS])
"""Beats of harmonics of a Gaussian, by layout."""


@dataclass(frozen=True, eq=False)
class PackedModel(ModelHeader):
    """The image of a model in DRAM.

    Its length and its Gaussians are the finest level's; `count` and `stored` are about all chunks.
    """

    def __post_init__(self):
        """Raise InputError, naming the field, unless the header describes the image."""
        super().__post_init__()
        refuse, degree, codebooks = self.refuse, self.value("sh_degree"), self.format.codebooks
        if len(self.image) < self.layout_of(0).positions:
            refuse("count", f"{self.count} needs chunk headers beyond the file's end")
        if codebooks and self.chunks["harmonics"].any():
            refuse("harmonics", "of a chunk do not go with codebooks")
        for k in np.flatnonzero(np.bincount(self.chunks["harmonics"])):
            if LAYOUTS[k].halves and LAYOUTS[k].degree > degree:
                refuse("harmonics", f"{k} of a chunk does not go with SH degree {degree}")
        expected = self.layout.end
        if len(self.image) != expected:
            refuse("count", f"{self.count} needs {expected} bytes but there are {len(self.image)}")
        for part in memory.PLACED:
            if self.value(part) * memory.ALIGNMENT != getattr(self.layout, part):
                refuse(part, f"{self.value(part) * memory.ALIGNMENT} is not where this part begins")
        if self.value("checksum") != checksum(self.image):
            refuse("checksum", "is wrong: the file is damaged")
        if self.levels and (found := fault(self.levels, self.chunk_beats)):
            refuse(*found)

    def __len__(self) -> int:
        """Return the number of Gaussians of the finest level."""
        return self.count if self._finest is None else len(self._finest)

    @cached_property
    def _finest(self) -> np.ndarray | None:
        """Numbers of the stored Gaussians of the finest level; None: all."""
        if not self.levels:
            return None
        coarse = np.repeat(self.levels["error"] > 0, memory.CHUNK)[: self.count]
        return np.flatnonzero(~coarse)

    @cached_property
    def layout(self) -> memory.Layout:
        """Byte offsets of the parts."""
        return self.layout_of(int(memory.chunk_sizes(self.count) @ (self.chunk_beats - 1)))

    @cached_property
    def chunk_beats(self) -> np.ndarray:
        """Beats [C] of attributes per Gaussian of each chunk."""
        return 1 + LAYOUT_BEATS[self.chunks["harmonics"]]

    @cached_property
    def _chunk_begins(self) -> np.ndarray:
        """First beat [C] of each chunk's attributes, counted from the model's first."""
        beats = self.chunk_beats * memory.CHUNK
        return np.cumsum(beats) - beats

    def first_beats(self, index: np.ndarray) -> np.ndarray:
        """Return the first beat [M] of Gaussians' attributes, counted from the model's first."""
        if self.format.small:
            return index // 2
        of, place = np.divmod(index, memory.CHUNK)
        return self._chunk_begins[of] + place * self.chunk_beats[of]

    @property
    def beats(self) -> np.ndarray:
        """First beat [N] of each Gaussian's attributes, counted from the model's first."""
        return self.first_beats(np.arange(self.count))

    def attribute_bursts(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return first beats and lengths of the bursts that read the attributes of Gaussians.

        index: [M] ascending; neighbours in a small model may share a beat, and then a burst
        """
        if self.format.small:
            first = np.unique(index // 2)
            return first, np.ones_like(first)
        return self.first_beats(index), self.chunk_beats[index // memory.CHUNK]

    def _records(self, record: Record, start: int, count: int) -> dict[str, np.ndarray]:
        """Return the codes of `count` records at byte `start`."""
        part = self.image[start : start + count * record.size]
        return record.unpack(part.reshape(count, record.size))

    @cached_property
    def chunks(self) -> dict[str, np.ndarray]:
        """Values of the chunk headers: the fields of `spec.memory.CHUNK_HEADER`."""
        return self._headers(memory.CHUNK_HEADER, memory.LEVEL_SIZE * self.format.levels)

    @cached_property
    def levels(self) -> Levels | None:
        """Values of the records of `spec.levels.LEVEL`; None: the model has no levels."""
        if not self.format.levels:
            return None
        return self._headers(LEVEL, 0)

    def _headers(self, record: Record, place: int) -> dict[str, np.ndarray]:
        """Return the values of a record at byte `place` of each chunk's header."""
        start, stride = self.layout_of(0).chunks, self.format.header_stride
        count = memory.chunk_count(self.count)
        rows = self.image[start : start + count * stride].reshape(count, stride)
        rows = np.ascontiguousarray(rows[:, place : place + record.size])
        return record.decode(record.unpack(rows))

    def attribute_beats(self, index: np.ndarray) -> np.ndarray:
        """Return the beats [M, 16] of attributes with the given numbers, uint8."""
        part, size = self.image[self.layout.attributes :], memory.ATTRIBUTE_BITS // 8
        return part[: len(part) // size * size].reshape(-1, size)[index]

    def harmonics(
        self, index: np.ndarray, layout: Harmonics
    ) -> tuple[dict[int, np.ndarray], dict[int, np.ndarray]]:
        """Return codes [M, k, 3] and shifts [M] of each degree from 1 on.

        index: [M] Gaussians of chunks with this layout
        layout: one of `LAYOUTS`
        """
        first = self.first_beats(index)
        beats = [
            record.unpack(self.attribute_beats(first + 1 + k))
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

    def codebook(self, degree: int) -> tuple[str, tuple[int, ...], np.ndarray]:
        """Return a codebook's name, the index bits of its stages, and all their entries [E, D]."""
        return self._codebooks[degree]

    @cached_property
    def _codebooks(self) -> list[tuple[str, tuple[int, ...], np.ndarray]]:
        """The codebooks of the colour and of degree 1."""
        format, layout = self.format, self.layout
        colour = "colour", format.colour_index, layout.colours, memory.COLOUR_ENTRY, "rgb"
        slopes = "sh", format.sh_index, layout.sh, memory.SH_ENTRY, "g"
        found = []
        for part, stages, start, entry, field in (colour, slopes):
            codes = self._records(entry, start, sum(1 << bits for bits in stages))[field]
            found.append((part, stages, entry[field].decode(codes)))
        return found

    def decoded(self, index=slice(None)) -> Decoded:
        """Return the Gaussians that a numpy index (slice, mask or integers) selects."""
        if self._finest is not None:
            return Decoded(self, self._finest[index])
        return self.stored(index)

    def stored(self, index=slice(None)) -> Decoded:
        """Return stored Gaussians of all levels, selected by a numpy index."""
        if isinstance(index, slice):
            return Decoded(self, np.arange(*index.indices(self.count)))
        index = np.asarray(index)
        if index.dtype == bool:
            return Decoded(self, np.flatnonzero(index))
        return Decoded(self, np.where(index < 0, index + self.count, index).astype(np.int64))

    @property
    def stored_positions(self) -> np.ndarray:
        """Codes [N, 3] of the stored positions."""
        return self.decoded().stored_positions

    @property
    def stored_attributes(self) -> np.ndarray:
        """Each Gaussian's first attributes as stored: uint8 [N, 16], in small models [N, 8]."""
        return self.decoded().stored_attributes

    @property
    def attributes(self) -> dict[str, np.ndarray]:
        """Codes [N] of each Gaussian's first beat of attributes, by field."""
        return self.decoded().attributes

    @property
    def grid(self) -> np.ndarray:
        """Positions [N, 3] in grid steps, int64."""
        return self.decoded().grid

    @property
    def position(self) -> np.ndarray:
        """Positions [N, 3], scene units, exact in float64."""
        return self.decoded().position

    @property
    def factor(self) -> np.ndarray:
        """L [N, 3, 3], scene units."""
        return self.decoded().factor

    @property
    def opacity(self) -> np.ndarray:
        """Opacities [N]."""
        return self.decoded().opacity

    @property
    def factors(self) -> list[np.ndarray]:
        """Factors [N, k, 3] of `spec.colour`'s polynomials, for each degree."""
        return self.decoded().factors

    @property
    def sh(self) -> np.ndarray:
        """Coefficients [N, (degree+1)², 3] in the order of 3DGS."""
        return self.decoded().sh

    def gaussians(self, rows: slice = slice(None)) -> Gaussians:
        """Return the Gaussians, or some of them, exactly as the hardware reads them."""
        some = self.decoded(rows)
        count, sh = len(some), sh_count(self.format.sh_degree)
        shapes = {"position": (3,), "factor": (3, 3), "opacity": (), "sh": (sh, 3)}
        found = {name: np.empty((count, *shape)) for name, shape in shapes.items()}
        for batch in batches(count):
            part = some[batch]
            for name, values in found.items():
                values[batch] = getattr(part, name)
        return Gaussians(**found, antialiased=self.antialiased)

    @property
    def bytes_per_gaussian(self) -> float:
        """Bytes per Gaussian of the whole model except its codebooks."""
        return (len(self.image) - self.format.codebook_bytes) / max(len(self), 1)


Drawn = Gaussians | Scene | PackedModel | Decoded
"""Gaussians for a renderer: `decoded(index)` returns some of them."""


def checksum(image: np.ndarray) -> int:
    """Return the CRC-32 of everything except the checksum itself."""
    place = memory.HEADER.offset("checksum") // 8
    start = zlib.crc32(np.ascontiguousarray(image[:place]))
    rest = image[place + memory.HEADER["checksum"].width // 8 :]
    return zlib.crc32(np.ascontiguousarray(rest), start)
