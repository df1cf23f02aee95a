"""Quantised Gaussians to the image in DRAM: every part of `spec.memory`, packed and placed."""

from dataclasses import dataclass

import numpy as np

from splatcore.model.pack.chunk import Chunks
from splatcore.model.pack.codebook import Codebook
from splatcore.model.pack.factor import largest_axis
from splatcore.spec import memory
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.memory import HEADER, ModelFormat
from splatcore.spec.packed import checksum
from splatcore.spec.record import Record, pack_bits


@dataclass(frozen=True, eq=False)
class Quantised:
    """N Gaussians in stored order, every number already rounded to what its format holds."""

    format: ModelFormat
    chunks: Chunks
    position: np.ndarray  # [N, 3] codes as they are stored
    factor: np.ndarray  # [N, 3, 3] L in units of 2^factor_exponent
    factor_exponent: int
    attenuation: np.ndarray  # [N] −log2(opacity)
    colour: Codebook
    harmonics: Codebook

    def __len__(self) -> int:
        return len(self.position)


def lay_out(model: Quantised) -> np.ndarray:
    """The image in DRAM, uint8."""
    layout = model.format.layout(len(model))
    image = np.zeros(layout.end, np.uint8)

    def put(start: int, data: np.ndarray):
        image[start : start + data.size] = data.reshape(-1)

    width = model.format.position_record["x"].width
    put(layout.chunks, chunk_headers(model))
    put(layout.positions, pack_bits(model.position.reshape(-1).astype(np.uint64), width))
    put(layout.attributes, attributes(model))
    put(layout.colours, entries(memory.COLOUR_ENTRY, "rgb", model.colour))
    put(layout.sh, entries(memory.SH_ENTRY, "g", model.harmonics))
    put(layout.header, header(model, check=0))
    put(layout.header, header(model, checksum(image)))
    return image


def header(model: Quantised, check: int) -> np.ndarray:
    """The model's header, uint8 [1, size]."""
    format = model.format
    stages = HEADER["colour_index"].length
    absolute = format.position == "absolute"
    numbers = {
        "magic": memory.MAGIC,
        "version": memory.VERSION,
        "sh_degree": format.sh_degree,
        "position": memory.POSITION_FORMATS.index(format.position),
        "count": len(model),
        "checksum": check,
        "position_exponent": memory.ABSOLUTE_EXPONENT if absolute else model.chunks.exponent,
        "factor_exponent": model.factor_exponent,
        "colour_exponent": model.colour.exponent,
        "sh_exponent": model.harmonics.exponent,
    }
    layout = format.layout(len(model))
    numbers |= {part: getattr(layout, part) // memory.ALIGNMENT for part in memory.PLACED}
    codes = {field: HEADER[field].encode(np.array([value])) for field, value in numbers.items()}
    for field in ("colour_index", "sh_index"):
        bits = getattr(format, field)
        codes[field] = np.array([bits + (0,) * (stages - len(bits))])
    return HEADER.pack(codes | {"reserved": np.zeros((1, HEADER["reserved"].length), np.uint64)})


def chunk_headers(model: Quantised) -> np.ndarray:
    """Chunk headers, uint8 [C, size].

    A Gaussian has alpha ≥ 1/255 at most √(2·ln(255·opacity)) standard deviations from its centre.
    """
    chunks = model.chunks
    starts = np.arange(0, len(model), memory.CHUNK)
    deviations = np.sqrt(2 * np.log(np.maximum(np.exp2(-model.attenuation) / ALPHA_MIN, 1)))
    reach = deviations * np.ldexp(largest_axis(model.factor), model.factor_exponent)
    reach = np.maximum.reduceat(reach, starts) if len(starts) else reach
    code = memory.REACH.encode(reach)
    code += memory.REACH.decode(code) < reach  # a bound is rounded up
    fields = {name: getattr(chunks, name) for name in ("shift", "extent", "octant_end")}
    fields["origin"] = memory.CHUNK_HEADER["origin"].encode(chunks.origin)
    if model.format.position == "absolute":
        fields = {name: np.zeros_like(codes) for name, codes in fields.items()}
    reserved = np.zeros(len(starts), np.uint64)
    return memory.CHUNK_HEADER.pack(fields | {"reach": code, "reserved": reserved})


def attributes(model: Quantised) -> np.ndarray:
    """Attributes, uint8 [N, size]."""
    record = model.format.attribute_record
    places = zip(*np.tril_indices(3), strict=True)
    values = {f"l{row}{column}": model.factor[:, row, column] for row, column in places}
    values["opacity"] = model.attenuation
    values |= {f"colour{stage}": index for stage, index in enumerate(model.colour.index)}
    values |= {f"sh{stage}": index for stage, index in enumerate(model.harmonics.index)}
    if "reserved" in dict(record.fields):
        values["reserved"] = np.zeros(len(model), np.uint64)
    return record.pack(record.encode(values))


def entries(record: Record, field: str, codebook: Codebook) -> np.ndarray:
    """All stages' entries one after the other, uint8 [entries, size]."""
    if not codebook.entries:
        return np.zeros((0, record.size), np.uint8)
    values = np.concatenate(codebook.entries)
    reserved = np.zeros(len(values), np.uint64)
    return record.pack({field: record[field].encode(values), "reserved": reserved})
