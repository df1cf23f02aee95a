"""KSPLAT scenes, version 0.1: compression levels 0 to 2, SH degrees 0 to 2.

Source: github.com/mkkellogg/GaussianSplats3D 0.4.7, `src/loaders/SplatBuffer.js`. A file is its
header, a header per section, then per section: numbers of Gaussians in buckets that are not full
(uint32 each), centres of all buckets (3 × float32 each), Gaussians. Level 0 has no buckets; levels
1 and 2 store positions relative to the centre of the Gaussian's bucket. Axes are those of a PLY.
"""

import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error
from splatcore.spec.colour import SH_C0
from splatcore.spec.scene import Scene, joined, sh_count

HEADER = np.dtype(
    {
        "names": ["major", "minor", "sections", "count", "level", "low", "high"],
        "formats": ["u1", "u1", "<u4", "<u4", "<u2", "<f4", "<f4"],
        "offsets": [0, 1, 4, 16, 20, 36, 40],
        "itemsize": 4096,
    }
)
"""low, high: range of harmonics of 8 bits."""

SECTION = np.dtype(
    {
        "names": "count room capacity buckets block stride steps full partial degree".split(),
        "formats": "<u4 <u4 <u4 <u4 <f4 <u2 <u4 <u4 <u4 <u2".split(),
        "offsets": [0, 4, 8, 12, 16, 20, 24, 32, 36, 40],
        "itemsize": 1024,
    }
)
"""count: Gaussians; room: Gaussians for which the section has space
capacity: Gaussians of a full bucket; full, partial: numbers of full and other buckets
block: side of a bucket in scene units; steps: 16-bit steps in half a side
stride: bytes of a bucket's centre
"""

STEPS = 32767  # where a section states 0

RANGE = 1.5  # of harmonics of 8 bits, where the header states 0

DEGREE_MAX = 2

SECTIONS_MAX = 1 << 14
"""Largest accepted number of sections; writers make one by default."""

_TYPES = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))
"""Types of positions, scales and quaternions, harmonics by level."""


def read(path: str | os.PathLike) -> Scene:
    """Read the scene of a KSPLAT file."""
    data = file.read_bytes(path)
    if len(data) < HEADER.itemsize:
        raise input_error(path, f"{len(data)} bytes are too few for the header of a KSPLAT file")
    header = np.frombuffer(data, HEADER, 1)[0]
    if (header["major"], header["minor"]) != (0, 1):
        fault = f"KSPLAT version {header['major']}.{header['minor']} is not supported"
        raise input_error(path, fault)
    level, claimed = int(header["level"]), int(header["count"])
    if level >= len(_TYPES):
        raise input_error(path, f"compression level {level} is not 0, 1 or 2")
    file.check_count(claimed, path)
    number = int(header["sections"])
    if number > SECTIONS_MAX:
        raise input_error(path, f"{number} sections are more than {SECTIONS_MAX}")
    start = HEADER.itemsize + number * SECTION.itemsize
    if start > len(data):
        raise input_error(path, f"headers of {number} sections do not fit in {len(data)} bytes")
    sections, parts = np.frombuffer(data, SECTION, number, HEADER.itemsize), []
    for index, section in enumerate(sections):
        table, centres, start = _tables(data, start, section, level, f"{path}: section {index}")
        if len(table):
            parts.append(_scene(path, table, centres, section, header))
    held = sum(map(len, parts))
    if held != claimed:
        raise input_error(path, f"sections hold {held} Gaussians, the header says {claimed}")
    scene, rest = joined(parts), len(data) - start
    if len(sections) == 1:
        size = table.dtype["sh"].base.itemsize
        file.check_degree(scene.sh_degree, held, size, rest, path)
    scale, notes = file.unsigned(scene.scale)
    return replace(scene, scale=scale, notes=notes + file.surplus(rest))


def record(level: int, degree: int) -> np.dtype:
    """The record of a Gaussian. Scales are linear, colours RGBA, quaternions (w, x, y, z);
    harmonics are ordered by degree, then channel, then coefficient."""
    position, half, sh = _TYPES[level]
    return np.dtype(
        [
            ("position", position, 3),
            ("scale", half, 3),
            ("quaternion", half, 4),
            ("colour", "u1", 4),
            ("sh", sh, (3 * (sh_count(degree) - 1),)),
        ]
    )


def _tables(
    data: bytes, start: int, section: np.void, level: int, where: str
) -> tuple[np.ndarray, np.ndarray | None, int]:
    """The records [N] of the section that begins at an offset, the centres [N, 3] of their buckets
    (None in level 0), and the offset of its end."""
    names = ("count", "room", "degree", "buckets", "partial", "stride")
    count, room, degree, buckets, partial, stride = (int(section[name]) for name in names)
    if degree > DEGREE_MAX:
        raise input_error(where, f"SH degree {degree} is not 0, 1 or 2")
    if count > room:
        raise input_error(where, f"{count} Gaussians exceed its room for {room}")
    kind, begin = record(level, degree), start + 4 * partial + stride * buckets
    end = begin + room * kind.itemsize
    if end > len(data):
        fault = f"{room} Gaussians of SH degree {degree} in {buckets} buckets do not fit in the"
        raise input_error(where, f"{fault} {max(len(data) - start, 0)} bytes that are left")
    table = np.frombuffer(data, kind, count, begin)
    if level == 0 or not count:
        return table, None, end
    if buckets != int(section["full"]) + partial:
        claim = f"{section['full']} full and {partial} other buckets"
        raise input_error(where, f"has {buckets} buckets, not {claim}")
    if stride != 12:
        raise input_error(where, f"centres of buckets have {stride} bytes, not 12")
    centres = np.frombuffer(data, "<f4", 3 * buckets, start + 4 * partial).reshape(-1, 3)
    lengths = np.frombuffer(data, "<u4", partial, start)
    return table, centres[_buckets(section, lengths, where)], end


def _buckets(section: np.void, lengths: np.ndarray, where: str) -> np.ndarray:
    """The bucket [N] of each Gaussian: full ones come first, then those with `lengths`."""
    count, capacity, full = (int(section[name]) for name in ("count", "capacity", "full"))
    if capacity * full > section["room"]:
        raise input_error(where, f"{full} buckets of {capacity} exceed its room")
    ends = capacity * full + np.cumsum(lengths, dtype=np.int64)
    held = int(ends[-1]) if len(ends) else capacity * full
    if held < count:
        raise input_error(where, f"its buckets hold {held} of {count} Gaussians")
    index = np.arange(count)
    others = full + np.searchsorted(ends, index, side="right")
    return np.where(index < capacity * full, index // max(capacity, 1), others)


def _scene(
    path: str | os.PathLike,
    table: np.ndarray,
    centres: np.ndarray | None,
    section: np.void,
    header: np.void,
) -> Scene:
    """The scene of a section; scales keep their signs."""

    def convert(rows: slice) -> Scene:
        some = table[rows]
        position, colour = some["position"].astype(np.float64), some["colour"] / 255
        if centres is not None:
            steps = int(section["steps"]) or STEPS
            position = (position - steps) * (float(section["block"]) / 2 / steps) + centres[rows]
        sh = np.concatenate(
            [((colour[:, :3] - 0.5) / SH_C0)[:, None], *_higher(some["sh"], section, header)],
            axis=1,
        )
        arrays = position, some["scale"], some["quaternion"], colour[:, 3], sh
        return Scene(*arrays, os.fspath(path))

    return file.in_batches(len(table), convert)


def _higher(stored: np.ndarray, section: np.void, header: np.void) -> Iterator[np.ndarray]:
    """Yield the coefficients [N, 2·degree + 1, 3] of each degree from 1 on."""
    higher, start = stored.astype(np.float64), 0
    if header["level"] == 2:
        low, high = float(header["low"]) or -RANGE, float(header["high"]) or RANGE
        higher = low + higher / 255 * (high - low)
    for degree in range(1, int(section["degree"]) + 1):
        each, end = 2 * degree + 1, start + 3 * (2 * degree + 1)
        yield higher[:, start:end].reshape(-1, 3, each).transpose(0, 2, 1)
        start = end
