"""A packed model: the bytes that lie in DRAM or in a file, and what they stand for."""

import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from splatcore.spec import memory
from splatcore.spec.error import InputError
from splatcore.spec.memory import CHUNK, CHUNK_HEADER, HEADER, Layout, ModelFormat, chunk_count
from splatcore.spec.record import Record, unpack_bits
from splatcore.spec.scene import Gaussians

SH_C0 = 1 / np.sqrt(4 * np.pi)
SH_C1 = np.sqrt(3 / (4 * np.pi))
"""Constants of the harmonics of degree 0 and 1; degree 1 is (−C1·y, C1·z, −C1·x) in 3DGS."""


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


def slopes_from_sh(sh: np.ndarray) -> np.ndarray:
    """G [N, 3, 3] (colour channel × direction axis) of degree-1 coefficients [N, 3, 3] (k × RGB).

    Colour = … + G·direction, so G's columns are −C1·sh₃, −C1·sh₁, C1·sh₂.
    """
    return SH_C1 * np.stack([-sh[:, 2], -sh[:, 0], sh[:, 1]], axis=2)


def sh_from_slopes(slopes: np.ndarray) -> np.ndarray:
    """The inverse of `slopes_from_sh`."""
    x, y, z = np.moveaxis(slopes, 2, 0) / SH_C1
    return np.stack([-y, z, -x], axis=1)


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
            refuse("version", f"{self.value('version')} is not {memory.VERSION}")
        if self.value("sh_degree") > 1:
            refuse("sh_degree", f"{self.value('sh_degree')} is not 0 or 1")
        if self.value("position") >= len(memory.POSITION_FORMATS):
            refuse("position", f"{self.value('position')} is unknown")
        for field in ("position_exponent", "factor_exponent", "colour_exponent", "sh_exponent"):
            if abs(self.value(field)) > memory.EXPONENT_MAX:
                refuse(field, f"{self.value(field)} is not within ± {memory.EXPONENT_MAX}")
        for field in ("colour_index", "sh_index"):
            if self.header[field].max() > 16:
                refuse(field, f"of {self.header[field].max()} bits is over 16")
        if bool(self.header["sh_index"].any()) != (self.format.sh_degree > 0):
            refuse("sh_index", f"does not go with SH degree {self.format.sh_degree}")
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
    def layout(self) -> Layout:
        return self.format.layout(len(self))

    def _records(self, record: Record, start: int, count: int) -> dict[str, np.ndarray]:
        part = self.image[start : start + count * record.size]
        return record.unpack(part.reshape(count, record.size))

    @cached_property
    def chunks(self) -> dict[str, np.ndarray]:
        """Values of the chunk headers: the fields of `spec.memory.CHUNK_HEADER`."""
        codes = self._records(CHUNK_HEADER, self.layout.chunks, chunk_count(len(self)))
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

    @cached_property
    def attributes(self) -> dict[str, np.ndarray]:
        """Codes of the attributes, by field [N]."""
        return self._records(self.format.attribute_record, self.layout.attributes, len(self))

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
    def colour(self) -> np.ndarray:
        """Colours [N, 3] before the harmonics: SH0·C0 + 0.5."""
        return self._codebook("colour", self.layout.colours, memory.COLOUR_ENTRY, "rgb")

    @property
    def slopes(self) -> np.ndarray:
        """G [N, 3, 3] in colour + G·direction (colour channel × axis), of models of degree 1."""
        return self._codebook("sh", self.layout.sh, memory.SH_ENTRY, "g").reshape(-1, 3, 3)

    def _codebook(self, part: str, start: int, entry: Record, field: str) -> np.ndarray:
        """The sums [N, D] of the entries that the attributes' indices choose."""
        stages = self.format.colour_index if part == "colour" else self.format.sh_index
        table = self._records(entry, start, sum(1 << bits for bits in stages))[field]
        values = entry[field].decode(table)
        total, base = np.zeros((len(self), values.shape[1])), 0
        for stage, bits in enumerate(stages):
            total += values[base + self.attributes[f"{part}{stage}"].astype(np.int64)]
            base += 1 << bits
        return np.ldexp(total, self.value(f"{part}_exponent"))

    @property
    def sh(self) -> np.ndarray:
        """[N, (degree+1)², 3] in the order of 3DGS."""
        parts = [((self.colour - 0.5) / SH_C0)[:, None]]
        if self.format.sh_degree:
            parts.append(sh_from_slopes(self.slopes))
        return np.concatenate(parts, axis=1)

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
