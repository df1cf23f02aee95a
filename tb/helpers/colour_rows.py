"""Models and points for tests of the projection's colours: random codes, random rays."""

from collections.abc import Callable

import numpy as np

from splatcore.golden.project import project
from splatcore.model.generate.generate import generated_camera
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import Config
from splatcore.spec.depth import low_format
from splatcore.spec.frame import frame_constants
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import (
    CHUNK,
    CHUNK_HEADER,
    HEADER,
    MAGIC,
    PLACED,
    POSITION_FORMATS,
    VERSIONS,
    ModelFormat,
    chunk_count,
)
from splatcore.spec.packed import PackedModel, checksum
from splatcore.spec.point import point_record, projecting_record
from splatcore.spec.record import Record
from tb.helpers.point_rows import (
    attribute_rows,
    codebook_rows,
    packed_splats,
    registers,
    wanted_rows,
)
from tb.helpers.runs import Case
from tb.stages.points import PARTS, constants

Draw = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]
"""Random bytes."""


def any_bytes(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return rng.integers(0, 256, shape, np.uint8)


def few_bits(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Bytes with long runs of equal bits: codes at both ends of their range and around zero."""
    runs = rng.geometric(0.08, 8 * int(np.prod(shape)) + 1)
    bits = np.repeat(np.arange(len(runs)) % 2, runs)[: 8 * int(np.prod(shape))]
    return np.packbits(bits.astype(np.uint8)).reshape(shape)


def random_model(
    format: ModelFormat,
    layouts: np.ndarray,
    exponent: list[int],
    rng: np.random.Generator,
    draw: Draw = any_bytes,
    last: int = CHUNK,
    antialiased: bool = False,
) -> PackedModel:
    """A model with random attributes, codebooks and steps.

    layouts: [C] of the chunks
    last: Gaussians of the last chunk
    """
    count = (len(layouts) - 1) * CHUNK + last
    each = np.minimum(count - np.arange(chunk_count(count)) * CHUNK, CHUNK)
    beats = int(each @ np.array([layout.beats for layout in LAYOUTS])[layouts])
    layout = format.layout(count, beats)
    image = np.zeros(layout.end, np.uint8)
    image[layout.attributes :] = draw(rng, (layout.end - layout.attributes,))
    fields = _zeros(CHUNK_HEADER, len(layouts))
    fields["harmonics"] = layouts.astype(np.uint64)
    fields["step"] = rng.integers(0, 16, fields["step"].shape, np.uint64)
    rows = CHUNK_HEADER.pack(fields)
    if format.levels:  # all chunks are finest ones
        each = np.array([layout.beats for layout in LAYOUTS])[layouts] + 1
        number = np.arange(1, len(layouts) + 1)
        ends = {"last": number**0, "jump": number, "beats": np.cumsum(each)}
        ends = {name: codes.astype(np.uint64) for name, codes in ends.items()}
        rows = np.hstack([LEVEL.pack(_zeros(LEVEL, len(layouts)) | ends), rows])
    image[layout.chunks : layout.chunks + rows.size] = rows.reshape(-1)
    fields = _zeros(HEADER, 1)
    fields |= {
        name: np.array([value], np.uint64)
        for name, value in {
            "magic": MAGIC,
            "version": VERSIONS[-1 if format.levels else antialiased],
            "levels": format.levels,
            "antialiased": antialiased,
            "sh_degree": format.sh_degree,
            "position": POSITION_FORMATS.index(format.position),
            "small": format.small,
            "count": count,
            **{part: getattr(layout, part) // 64 for part in PLACED},
        }.items()
    }
    fields["exponent"] = HEADER["exponent"].encode(np.array([exponent]))
    for name in ("colour_index", "sh_index"):
        bits = getattr(format, name)
        fields[name][0, : len(bits)] = bits
    for check in (0, 1):
        if check:
            fields["checksum"] = np.array([checksum(image)], np.uint64)
        image[: HEADER.size] = HEADER.pack(fields)
    return PackedModel(image, "random")


def _zeros(record: Record, count: int) -> dict[str, np.ndarray]:
    return record.unpack(np.zeros((count, record.size), np.uint8))


def random_rays(config: Config, rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """Rays of all kinds: in any direction, along an axis or nearly, tiny, huge, and zero."""
    way = rng.normal(size=(count, 3))
    kind = rng.integers(0, 6, count)
    way[kind == 1] *= rng.integers(-1, 2, (np.sum(kind == 1), 3))  # some coordinates 0
    axis = np.eye(3)[rng.integers(0, 3, count)] * rng.choice([-1, 1], (count, 1))
    way = np.where((kind == 2)[:, None], axis, way)
    way = np.where(
        (kind == 3)[:, None], axis + way * np.exp2(-rng.integers(4, 20, (count, 1))), way
    )
    scale = np.where(kind == 4, rng.integers(-66, 66, count), rng.integers(-6, 10, count))
    way = np.ldexp(way, scale[:, None])
    way = np.where((kind == 5)[:, None], np.ldexp(way, rng.integers(-66, 66, (count, 3))), way)
    way[rng.random(count) < 0.01] = 0
    if config.arithmetic.overflow == "infinity":  # infinity times a slope of 0 is no number
        way = np.copysign(np.clip(np.abs(way), 2.0**-6, 2.0**6), way)
    return {f"ray_{a}": config.arithmetic.round(way[:, k]) for k, a in enumerate("xyz")}


def project_case(
    config: Config, model: PackedModel, rng: np.random.Generator, kept: float = 0.8
) -> Case:
    """The projection of points with a model's attributes, but random coordinates and rays."""
    frame = frame_constants(config, generated_camera("garden"), 0, 0, model.antialiased)
    index = np.arange(len(model))
    last = (index % CHUNK == CHUNK - 1) | (index == len(model) - 1)
    keep = rng.random(len(model)) < kept
    points = random_rays(config, rng, len(model))
    points |= dict(
        zip("xyz", config.arithmetic.round(rng.normal(size=(3, len(model)))), strict=True)
    )
    points["z"] = config.arithmetic.round(np.exp2(rng.uniform(-2, 6, len(model))))
    record = point_record(config, "x y z")
    low = low_format(config)
    points |= {name: rng.integers(0, 1 << one.width, len(model)) for name, one in low.items()}
    fields = {"place": index % CHUNK, "last": last, "kept": keep}
    codes = {name: value.astype(np.uint64) for name, value in fields.items()}
    codes |= {name: record[name].encode(value) for name, value in points.items()}
    sent, chosen = np.flatnonzero(keep | last), np.flatnonzero(keep)
    chunks = {"attributes": model.beats[::CHUNK], "harmonics": model.chunks["harmonics"]}
    chunks = {name: value.astype(np.uint64) for name, value in chunks.items()}
    chunks["step"] = model.chunks["step"].astype(np.uint64)
    found = project(config, frame, model, {n: p[chosen] for n, p in points.items()}, chosen)
    found |= {name: points[name][chosen] for name in low}
    return Case(
        {
            "i": record.pack({name: code[sent] for name, code in codes.items()}),
            "chunks": projecting_record().pack(chunks),
            "attributes": attribute_rows(model, chosen),
            "write": codebook_rows(config, model),
        },
        {"wanted": wanted_rows(model, chosen), "o": packed_splats(config, found)},
        constants(PARTS["project"](config), registers(config, frame, model)),
        first=("write",),
    )
