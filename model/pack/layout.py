"""The image of quantised Gaussians in DRAM: every part of `spec.memory`, packed and placed."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from splatcore.model.pack.chunk import Chunks
from splatcore.model.pack.codebook import Codebook
from splatcore.model.pack.factor import ABOUT, about_axis, largest_axis
from splatcore.model.pack.steps import Steps
from splatcore.spec import memory
from splatcore.spec.coded import WITH_BEATS, Rows, beats_in_all, image_of
from splatcore.spec.colour import CHANNELS, LAYOUTS, Harmonics
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.memory import HEADER, ModelFormat
from splatcore.spec.model_header import ModelHeader
from splatcore.spec.packed import checksum
from splatcore.spec.record import Record
from splatcore.spec.small import factor_codes


@dataclass(frozen=True, eq=False)
class Whole:
    """The numbers of a model that its Gaussians share."""

    format: ModelFormat
    count: int
    harmonics: np.ndarray  # [C] each chunk's layout, an index of `LAYOUTS`
    exponents: list[int]  # E of each degree
    position_exponent: int
    factor_exponent: int
    codebooks: tuple[Codebook, ...]  # of colours and of slopes G
    antialiased: bool


@dataclass(frozen=True, eq=False)
class Quantised:
    """N Gaussians of whole chunks, with every number already rounded to its format."""

    format: ModelFormat
    chunks: Chunks
    position: np.ndarray  # [N, 3] stored codes
    factor: np.ndarray  # [N, 3, 3] L in units of 2^factor_exponent
    factor_exponent: int
    attenuation: np.ndarray  # [N] −log2(opacity)
    steps: Steps  # `no_steps` if there are codebooks
    codebooks: tuple[Codebook, ...] = ()  # of colours and of slopes G

    def __len__(self) -> int:
        return len(self.position)


def lay_out(model: Whole, parts: Iterable[Rows], name: str) -> np.ndarray:
    """Make the image in DRAM, uint8.

    parts: `rows_of` all Gaussians, a batch at a time
    name: of the scene, for error messages
    """
    layout = model.format.layout(model.count, beats_in_all(model.harmonics, model.count))
    books = model.codebooks or (None, None)
    tables = [entries(memory.COLOUR_ENTRY, books[0]), entries(memory.SH_ENTRY, books[1])]
    head = ModelHeader(header(model, layout, check=0), name)
    image = image_of(head, model.harmonics, parts, tables)
    image[: HEADER.size] = header(model, layout, checksum(image))
    return image


def rows_of(part: Quantised) -> Rows:
    """Rows of the tables of chunks and Gaussians, uint8 [N, size] each."""
    of = np.repeat(part.steps.harmonics, memory.CHUNK)[: len(part)]
    return [
        chunk_headers(part),
        part.format.position_record.pack(dict(zip("xyz", part.position.T, strict=True))),
        attributes(part),
        *(harmonics(part.steps, LAYOUTS[k], np.flatnonzero(of == k)) for k in WITH_BEATS),
    ]


def header(model: Whole, layout: memory.Layout, check: int) -> np.ndarray:
    """The model's header, uint8 [size]."""
    format = model.format
    stages = HEADER["colour_index"].length
    absolute = format.position == "absolute"
    numbers = {
        "magic": memory.MAGIC,
        "version": memory.VERSIONS[model.antialiased],
        "sh_degree": format.sh_degree,
        "position": memory.POSITION_FORMATS.index(format.position),
        "small": format.small,
        "count": model.count,
        "checksum": check,
        "antialiased": model.antialiased,
        "levels": 0,
        "spare": 0,
        "position_exponent": memory.ABSOLUTE_EXPONENT if absolute else model.position_exponent,
        "factor_exponent": model.factor_exponent,
    }
    numbers |= {part: getattr(layout, part) // memory.ALIGNMENT for part in memory.PLACED}
    codes = {field: HEADER[field].encode(np.array([value])) for field, value in numbers.items()}
    codes["exponent"] = HEADER["exponent"].encode(np.array([model.exponents]))
    for field in ("colour_index", "sh_index"):
        bits = getattr(format, field)
        codes[field] = np.array([bits + (0,) * (stages - len(bits))])
    codes["reserved"] = np.zeros((1, HEADER["reserved"].length), np.uint64)
    return HEADER.pack(codes)[0]


def chunk_headers(model: Quantised) -> np.ndarray:
    """Chunk headers, uint8 [C, size]."""
    chunks, reach = model.chunks, largest_reach(model)
    code = memory.REACH.encode(reach)
    code += memory.REACH.decode(code) < reach  # a bound is rounded up
    fields = {name: getattr(chunks, name) for name in ("shift", "extent", "octant_end")}
    fields["origin"] = memory.CHUNK_HEADER["origin"].encode(chunks.origin)
    if model.format.position == "absolute":
        fields = {name: np.zeros_like(codes) for name, codes in fields.items()}
    steps = model.steps
    fields |= {"reach": code, "harmonics": steps.harmonics, "step": steps.s.astype(np.uint64)}
    return memory.CHUNK_HEADER.pack(fields)


def largest_reach(model: Quantised) -> np.ndarray:
    """The largest reach [C] of each chunk's Gaussians, scene units.

    A Gaussian's alpha reaches 1/255 within √(2·ln(255·opacity)) standard deviations of its centre.
    Only Gaussians whose approximate reach is near their chunk's largest need the exact one.
    """
    starts = np.arange(0, len(model), memory.CHUNK)
    deviations = np.sqrt(2 * np.log(np.maximum(np.exp2(-model.attenuation) / ALPHA_MIN, 1)))
    reach = deviations * np.ldexp(about_axis(model.factor), model.factor_exponent)
    if not len(starts):
        return reach
    largest = np.repeat(np.maximum.reduceat(reach, starts), memory.CHUNK)[: len(model)]
    near = np.flatnonzero(reach >= largest * (1 - 3 * ABOUT))
    axis = np.ldexp(largest_axis(model.factor[near]), model.factor_exponent)
    reach[:] = 0
    reach[near] = deviations[near] * axis
    return np.maximum.reduceat(reach, starts)


def attributes(model: Quantised) -> np.ndarray:
    """Attribute records without harmonics, uint8 [N, 16]; [N, 8] for a small model."""
    record = model.format.stored_record
    if model.format.small:
        values = factor_codes(model.factor)
    else:
        places = zip(*np.tril_indices(3), strict=True)
        values = {f"l{row}{column}": model.factor[:, row, column] for row, column in places}
    values["opacity"] = model.attenuation
    values |= zip(CHANNELS, model.steps.base.T, strict=not model.codebooks)
    for part, codebook in zip(("colour", "sh"), model.codebooks, strict=False):
        values |= {f"{part}{stage}": index for stage, index in enumerate(codebook.index)}
    if "reserved" in dict(record.fields):
        values["reserved"] = np.zeros(len(model), np.uint64)
    return record.pack(record.encode(values))


def harmonics(steps: Steps, layout: Harmonics, chosen: np.ndarray) -> np.ndarray:
    """Beats of harmonics, uint8 [M, 16·beats], of the `chosen` Gaussians [M], all of one layout."""
    values = {"reserved": np.zeros(len(chosen), np.uint64)}
    for degree in range(1, layout.degree + 1):
        has = degree <= len(steps.codes)
        values[f"shift{degree}"] = steps.shifts[degree - 1][chosen] if has else values["reserved"]
    for number, term in layout.terms:
        if term.degree <= len(steps.codes):
            of_term = slice(term.first, term.first + len(term.polynomials))
            codes = steps.codes[term.degree - 1][chosen, of_term]
        else:
            codes = np.zeros((len(chosen), len(term.polynomials), 3))
        values |= {f"{c}_{number}": codes[:, :, k] for k, c in enumerate(CHANNELS)}
    beats = [{name: values[name] for name, _ in record.fields} for record in layout.records]
    packed = [r.pack(r.encode(beat)) for r, beat in zip(layout.records, beats, strict=True)]
    return np.concatenate(packed, axis=1)


def entries(record: Record, codebook: Codebook | None) -> np.ndarray:
    """Entries of all stages, one stage after the other, uint8 [entries, size]."""
    (field, _), *_ = record.fields  # the other field is reserved
    if codebook is None or not codebook.entries:
        return np.zeros((0, record.size), np.uint8)
    values = np.concatenate(codebook.entries)
    reserved = np.zeros(len(values), np.uint64)
    return record.pack({field: record[field].encode(values), "reserved": reserved})
