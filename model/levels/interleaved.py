"""One model of several levels, depth first: chunks are copied unchanged, and get their records."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.spec.levels import LEVEL, PER_GROUP
from splatcore.spec.memory import (
    ALIGNMENT,
    CHUNK,
    CHUNK_HEADER,
    HEADER,
    PLACED,
    REACH,
    VERSIONS,
    chunk_count,
)
from splatcore.spec.packed import PackedModel, checksum
from splatcore.spec.record import Codes

Groups = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A level's first children [G + 1], errors [G], and corners of its subtrees [G, 3], scene units."""


def interleaved(models: Sequence[PackedModel], levels: Sequence[Groups]) -> PackedModel:
    """Return the model of all levels.

    models: the levels' chunks, the finest level first; all have the same grid and codebooks
    levels: the groups of the other levels
    """
    finest, count = models[0], sum(model.count for model in models)
    format = replace(finest.format, levels=True)
    place, codes = records(finest, levels, [model.chunks["reach"] for model in models])
    order = np.argsort(place)
    beats = np.concatenate([model.chunk_beats for model in models])[order]
    first = np.concatenate([[0], np.cumsum(beats)])
    codes = {field: rows[order] for field, rows in codes.items()}
    codes["beats"] = first[codes["jump"]].astype(np.uint64)

    short = -count % CHUNK * beats[-1:].sum()  # beats that the last chunk lacks
    layout = format.layout(count, int(first[-1] * CHUNK - short - count))
    image = np.zeros(layout.end, np.uint8)

    def put(start: int, end: int, rows: np.ndarray):
        data = rows.reshape(-1)[: end - start]
        image[start : start + len(data)] = data

    headers = [part(m, m.layout.chunks, CHUNK_HEADER.size, chunk_count(m.count)) for m in models]
    rows = np.concatenate([LEVEL.pack(codes), np.concatenate(headers)[order]], axis=1)
    put(layout.chunks, layout.positions, rows)
    size = format.position_stride
    rows = np.concatenate([part(m, m.layout.positions, size, chunk_count(m.count)) for m in models])
    put(layout.positions, layout.attributes, rows[order])
    size = CHUNK * format.stored_record.size  # a beat of all Gaussians of a chunk
    units = [part(m, m.layout.attributes, size, int(m.chunk_beats.sum())) for m in models]
    put(layout.attributes, layout.colours, np.concatenate(units)[runs(order, beats)])
    put(layout.colours, layout.end, finest.image[finest.layout.colours :])
    head = dict(finest.header)
    numbers = {"version": VERSIONS[-1], "levels": 1, "count": count, "checksum": 0}
    numbers |= {name: getattr(layout, name) // ALIGNMENT for name in PLACED}
    head |= {name: HEADER[name].encode(np.array([value])) for name, value in numbers.items()}
    image[: HEADER.size] = HEADER.pack(head)[0]
    head["checksum"] = HEADER["checksum"].encode(np.array([checksum(image)]))
    image[: HEADER.size] = HEADER.pack(head)[0]
    return PackedModel(image, finest.name)


def part(model: PackedModel, start: int, size: int, count: int) -> np.ndarray:
    """Return `count` rows of `size` bytes from byte `start` on, uint8; the last one may reach into
    other parts, or beyond the end, where it gets zeros."""
    rows = model.image[start : start + count * size]
    return np.pad(rows, (0, count * size - len(rows))).reshape(count, size)


def runs(order: np.ndarray, beats: np.ndarray) -> np.ndarray:
    """Return the rows of chunks in a new order; chunk `order[k]` has `beats[k]` rows in a row."""
    own = np.empty_like(beats)
    own[order] = beats
    begin = (np.cumsum(own) - own)[order]
    return np.repeat(begin - (np.cumsum(beats) - beats), beats) + np.arange(beats.sum())


def records(
    finest: PackedModel, levels: Sequence[Groups], reaches: Sequence[np.ndarray]
) -> tuple[np.ndarray, Codes]:
    """Return the place [C] of each chunk in the order of visits, and the codes [C] of the chunks'
    records except `beats`; chunks are the finest ones, then each level's.

    reaches: of the chunks of each level, scene units
    """
    sizes = [np.ones(chunk_count(finest.count), np.int64)]  # chunks of each group's subtree
    for children, *_ in levels:
        sizes.append(PER_GROUP + np.add.reduceat(sizes[-1], children[:-1]))
    starts = [np.zeros(len(sizes[-1]), np.int64)]
    for (children, *_), size in zip(levels[::-1], sizes[-2::-1], strict=True):
        before = np.cumsum(size) - size
        own = before - np.repeat(before[children[:-1]], np.diff(children))
        starts.append(np.repeat(starts[-1] + PER_GROUP, np.diff(children)) + own)
    starts.reverse()
    if not levels:
        starts = [np.arange(len(sizes[0]))]

    zeros = np.zeros(len(sizes[0]), np.uint64)
    fields = {"last": [zeros + 1], "jump": [starts[0] + 1]}
    fields |= {"centre": [np.zeros((len(zeros), 3), np.uint64)]}
    fields |= {name: [zeros] for name in ("radius", "around", "error")}
    reach = reaches[0]  # of each group's subtree
    places = [starts[0]]
    step = np.ldexp(1.0, finest.value("position_exponent"))
    for level, own_reach, start, size in zip(
        levels, reaches[1:], starts[1:], sizes[1:], strict=True
    ):
        children, error, low, high = level
        centre = np.rint((low + high) / 2 / step)
        away = np.maximum(high - centre * step, centre * step - low)
        radius = np.linalg.norm(away, axis=1)
        own = {"centre": LEVEL["centre"].encode(centre), "jump": start + size}
        own |= {"radius": upward(radius), "error": np.maximum(upward(error), 1)}
        below = np.maximum.reduceat(reach, children[:-1])
        reach = np.maximum(below, own_reach.reshape(-1, PER_GROUP).max(1))
        own["around"] = upward(radius + reach)
        for name, values in own.items():
            fields[name].append(np.repeat(values, PER_GROUP, axis=0))
        within = np.tile(np.arange(PER_GROUP), len(start))
        fields["last"].append((within == PER_GROUP - 1).astype(np.uint64))
        places.append(np.repeat(start, PER_GROUP) + within)
    codes = {name: np.concatenate(values).astype(np.uint64) for name, values in fields.items()}
    codes |= {name: np.zeros_like(codes["jump"]) for name in ("spare", "reserved")}
    return np.concatenate(places), codes


def upward(values: np.ndarray) -> np.ndarray:
    """Return codes [N] of `REACH` for values ≥ 0, rounded up."""
    code = REACH.encode(values)
    return code + (REACH.decode(code) < values)
