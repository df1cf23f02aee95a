"""A packed model: the bytes that lie in DRAM or in a file, and what they stand for."""

import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from splatcore.spec import convention, memory
from splatcore.spec.colour import (
    BASE,
    CHANNELS,
    DEGREES,
    EXPONENT_MAX,
    EXPONENT_MIN,
    LAYOUTS,
    SH_EXPONENT_MAX,
    Harmonics,
    coefficient_count,
    from_slopes,
    step,
    unfolded,
)
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.memory import (
    CHUNK,
    CHUNK_HEADER,
    HEADER,
    Layout,
    ModelFormat,
    chunk_count,
)
from splatcore.spec.record import Record, unpack_bits
from splatcore.spec.scene import Gaussians


def offsets(stored: np.ndarray, octant_end: np.ndarray) -> np.ndarray:
    """Whole offsets [N, 3] from their stored bits [N, 3] and the octant ends [C, 7]."""
    of, place = np.divmod(np.arange(len(stored)), CHUNK)
    octant = (place[:, None] >= octant_end[of]).sum(1)  # [N]
    top = octant[:, None] >> np.arange(3) & 1
    return stored.astype(np.int64) | top << memory.STORED_BITS


def grid_points(offset: np.ndarray, origin: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Positions [N, 3] in grid steps, int64, from offsets [N, 3] and chunk headers."""
    of = np.arange(len(offset)) // CHUNK
    return origin[of] + (offset << shift[of].astype(np.int64))


@dataclass(frozen=True, eq=False)
class PackedModel:
    """The image of a model in DRAM. `name` is the file or scene that messages speak of."""

    image: np.ndarray  # uint8 [layout.end]
    name: str = ""

    def __post_init__(self):
        """InputError, naming the field, unless the header describes the image."""

        def refuse(field: str, why: str):
            raise InputError(f"{self.name}: {field} {why}")

        if len(self.image) < HEADER.size or self.value("magic") != memory.MAGIC:
            refuse("magic", "is not that of a packed model")
        if self.value("version") != memory.VERSION:
            refuse(
                "version",
                f"{self.value('version')} is not {memory.VERSION}; make the model anew from its "
                "scene by: splatcore pack SCENE -o MODEL",
            )
        degree = self.value("sh_degree")
        if degree > SH_DEGREE_MAX:
            refuse("sh_degree", f"{degree} is not in 0 … {SH_DEGREE_MAX}")
        if self.value("position") >= len(memory.POSITION_FORMATS):
            refuse("position", f"{self.value('position')} is unknown")
        for field in ("position_exponent", "factor_exponent"):
            if abs(self.value(field)) > memory.EXPONENT_MAX:
                refuse(field, f"{self.value(field)} is not within ± {memory.EXPONENT_MAX}")
        for field in ("colour_index", "sh_index"):
            if self.header[field].max() > 16:
                refuse(field, f"of {self.header[field].max()} bits is over 16")
        codebooks = self.format.codebooks
        if codebooks and degree > memory.COMPACT_DEGREE:
            refuse("colour_index", f"names codebooks, which do not go with SH degree {degree}")
        if bool(self.header["sh_index"].any()) != (codebooks and degree > 0):
            refuse("sh_index", f"does not go with SH degree {degree}")
        least, most = EXPONENT_MIN, [EXPONENT_MAX] * DEGREES
        if codebooks:
            most[1] = SH_EXPONENT_MAX
        if not all(least <= e <= end for e, end in zip(self.exponents, most, strict=True)):
            refuse("exponent", f"{self.exponents} is not within {least} … {most}")
        if len(self.image) < self.layout_of(0).positions:
            refuse("count", f"{len(self)} has its chunk headers beyond the file's end")
        if codebooks and self.chunks["harmonics"].any():
            refuse("harmonics", "of a chunk do not go with codebooks")
        for k in np.unique(self.chunks["harmonics"]):
            if LAYOUTS[k].halves and LAYOUTS[k].degree > degree:
                refuse("harmonics", f"{k} of a chunk does not go with SH degree {degree}")
        try:
            expected = self.layout.end
        except ValueError as error:
            refuse("colour_index", str(error))
        if len(self.image) != expected:
            refuse("count", f"{len(self)} needs {expected} bytes but there are {len(self.image)}")
        for part in memory.PLACED:
            if self.value(part) * memory.ALIGNMENT != getattr(self.layout, part):
                refuse(part, f"is said to be at {self.value(part) * memory.ALIGNMENT}")
        if self.value("checksum") != checksum(self.image):
            refuse("checksum", "is wrong: the file is damaged")

    @cached_property
    def header(self) -> dict[str, np.ndarray]:
        """Codes of the header's fields, one record."""
        return HEADER.unpack(self.image[: HEADER.size].reshape(1, -1))

    def value(self, field: str) -> int:
        """A number of the header."""
        return int(HEADER[field].decode(self.header[field])[0])

    def __len__(self) -> int:
        return self.value("count")

    @property
    def format(self) -> ModelFormat:
        stages = {
            f: tuple(int(b) for b in self.header[f][0] if b) for f in ("colour_index", "sh_index")
        }
        position = memory.POSITION_FORMATS[self.value("position")]
        return ModelFormat(self.value("sh_degree"), position, **stages)

    @property
    def exponents(self) -> list[int]:
        """E of each degree."""
        return [int(e) for e in HEADER["exponent"].decode(self.header["exponent"])[0]]

    @cached_property
    def layout(self) -> Layout:
        counts = np.full(len(self.chunk_beats), CHUNK)
        counts[-1:] -= -len(self) % CHUNK
        return self.layout_of(int(counts @ (self.chunk_beats - 1)))

    def layout_of(self, harmonics: int) -> Layout:
        """Byte offsets with so many beats of harmonics."""
        return self.format.layout(len(self), harmonics)

    @cached_property
    def chunk_beats(self) -> np.ndarray:
        """Beats [C] of attributes of each of a chunk's Gaussians."""
        return 1 + np.array([layout.beats for layout in LAYOUTS])[self.chunks["harmonics"]]

    @cached_property
    def beats(self) -> np.ndarray:
        """The first beat [N] of each Gaussian's attributes, counted from their beginning on."""
        beats = np.repeat(self.chunk_beats, CHUNK)[: len(self)]
        return np.cumsum(beats) - beats

    def _records(self, record: Record, start: int, count: int) -> dict[str, np.ndarray]:
        part = self.image[start : start + count * record.size]
        return record.unpack(part.reshape(count, record.size))

    @cached_property
    def chunks(self) -> dict[str, np.ndarray]:
        """Values of the chunk headers: the fields of `spec.memory.CHUNK_HEADER`."""
        codes = self._records(CHUNK_HEADER, self.layout_of(0).chunks, chunk_count(len(self)))
        return CHUNK_HEADER.decode(codes)

    @property
    def stored_positions(self) -> np.ndarray:
        """Codes [N, 3] of the stored positions."""
        record, start = self.format.position_record, self.layout.positions
        width = record["x"].width
        return unpack_bits(self.image[start:], width, 3 * len(self)).reshape(-1, 3)

    @property
    def offsets(self) -> np.ndarray:
        """Offsets [N, 3] from the chunk's origin, of models with chunk positions."""
        return offsets(self.stored_positions, self.chunks["octant_end"])

    def attribute_beats(self, index: np.ndarray) -> np.ndarray:
        """Beats [M, 16] of attributes, uint8, by their numbers."""
        part, size = self.image[self.layout.attributes :], memory.ATTRIBUTE_BITS // 8
        return part[: len(part) // size * size].reshape(-1, size)[index]

    @cached_property
    def attributes(self) -> dict[str, np.ndarray]:
        """Codes of the first beats of attributes, by field [N]."""
        return self.format.attribute_record.unpack(self.attribute_beats(self.beats))

    @property
    def position(self) -> np.ndarray:
        """[N, 3] scene units, exact in float64."""
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
        """[N]"""
        record = self.format.attribute_record
        return np.exp2(-record["opacity"].decode(self.attributes["opacity"]))

    @property
    def factors(self) -> list[np.ndarray]:
        """Factors of `spec.colour`'s polynomials, for each degree [N, k, 3]; of degree 0 the colour
        without harmonics, less ½."""
        if not self.format.codebooks:
            return self._steps()
        colour = self._codebook(0, self.layout.colours, memory.COLOUR_ENTRY, "rgb")
        found = [colour[:, None] - convention.COLOUR_OFFSET]
        if self.format.sh_degree:
            g = self._codebook(1, self.layout.sh, memory.SH_ENTRY, "g")
            found.append(from_slopes(g.reshape(-1, 3, 3)))
        return found

    def _steps(self) -> list[np.ndarray]:
        """Factors of a model in steps."""
        found = [
            np.zeros((len(self), coefficient_count(d), 3)) for d in range(self.format.sh_degree + 1)
        ]
        of = np.arange(len(self)) // CHUNK
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
        """Codes [M, k, 3] and shifts [M] of each degree from 1 on, of Gaussians `index` [M] of
        chunks of that layout."""
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
        """The sums [N, D] of the entries that the attributes' indices choose."""
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
        """[N, (degree+1)², 3] in the order of 3DGS."""
        return unfolded(self.factors)

    def gaussians(self) -> Gaussians:
        """Exactly what the hardware sees."""
        return Gaussians(self.position, self.factor, self.opacity, self.sh)

    @property
    def bytes_per_gaussian(self) -> float:
        """Bytes of the whole model but its codebooks, for each Gaussian."""
        return (len(self.image) - self.format.codebook_bytes) / max(len(self), 1)


def checksum(image: np.ndarray) -> int:
    """CRC-32 of everything but the checksum itself."""
    place = HEADER.offset("checksum") // 8
    start = zlib.crc32(image[:place].tobytes())
    return zlib.crc32(image[place + HEADER["checksum"].width // 8 :].tobytes(), start)


def is_packed(path: str | Path) -> bool:
    """True if the file begins as a packed model does."""
    try:
        with open(path, "rb") as file:
            return int.from_bytes(file.read(4), "little") == memory.MAGIC
    except OSError:
        return False


def read_model(path: str | Path) -> PackedModel:
    """A packed model from a file; InputError names the file and the field."""
    try:
        image = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return PackedModel(image, str(path))
