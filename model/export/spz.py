"""Writing SPZ version 4, in RUB axes, which an extension record states.

Source: github.com/nianticlabs/spz; the container is checked against its reader in `formats.spz`.
Harmonics keep all 8 bits; other writers round them to 5 and 4 bits for smaller files.
"""

import os
import struct

import numpy as np
import zstandard

from splatcore.model.export.quaternion import smallest_three
from splatcore.model.formats import file
from splatcore.model.formats.file import input_error
from splatcore.model.formats.ply import log_scales
from splatcore.model.formats.spz import ANTIALIASED, COORDINATES, EXTENDED, FRACTION_MAX, SPZ_MAGIC
from splatcore.model.formats.spz_axes import AXES, SPZ_AXES, turned
from splatcore.spec.scene import Scene

POSITION_BITS = 24

LEVEL = 12  # of zstd, as splat-transform's


def write(path: str | os.PathLike, scene: Scene) -> None:
    """Write a scene; raises InputError for positions beyond ± 2²², the format's largest."""
    scene = turned(scene, SPZ_AXES)  # RUB to RDF and back are the same half turn
    fraction = fraction_bits(scene.position, path)
    sections = [section.tobytes() for section in codes(scene, fraction) if section.size]
    streams = [zstandard.compress(section, LEVEL) for section in sections]
    record = struct.pack("<III", COORDINATES, 4, AXES.index(SPZ_AXES) + 1)
    flags = EXTENDED | ANTIALIASED * scene.antialiased
    head = SPZ_MAGIC + struct.pack(
        "<IIBBBBI12x", 4, len(scene), scene.sh_degree, fraction, flags, len(streams),
        32 + len(record),
    )  # fmt: skip
    pairs = zip(streams, sections, strict=True)
    table = b"".join(struct.pack("<QQ", *map(len, pair)) for pair in pairs)
    with file.reading(path, "cannot be written"), open(path, "wb") as opened:
        opened.write(b"".join([head, record, table, *streams]))


def fraction_bits(position: np.ndarray, path: str | os.PathLike) -> int:
    """Return the most fractional bits with which all positions fit in 24 bits."""
    largest = np.abs(position).max(initial=0)
    _, bits = np.frexp(largest * (1 + 2.0**-22))  # whole bits, after rounding
    fraction = min(POSITION_BITS - 1 - int(bits), FRACTION_MAX)
    if fraction < 1:
        raise input_error(
            path, f"a position of {largest:g} is beyond SPZ's ± 2²²; use another format"
        )
    return fraction


def codes(scene: Scene, fraction: int) -> list[np.ndarray]:
    """Return the sections in file order, one row per Gaussian."""
    fixed = np.rint(np.ldexp(scene.position, fraction)).astype("<i4")
    sh = np.asarray(scene.sh, np.float64)
    position = fixed[:, :, None].view(np.uint8)[:, :, :3]  # little-endian, without the top byte
    return [
        position,
        to_byte(scene.opacity * 255),
        to_byte((sh[:, 0] * 0.15 + 0.5) * 255),
        to_byte((log_scales(scene) + 10) * 16),
        rotation_words(scene.quaternion),
        to_byte(sh[:, 1:] * 128 + 128),
    ]


def to_byte(value: np.ndarray) -> np.ndarray:
    """Round to 0 … 255."""
    return np.rint(np.clip(value, 0, 255)).astype(np.uint8)


def rotation_words(quaternion: np.ndarray) -> np.ndarray:
    """Return words [N]: 2 bits for the largest of x, y, z, w, then sign and 9 bits for each other
    one."""
    largest, others = smallest_three(quaternion[:, [1, 2, 3, 0]])
    size = np.rint(np.minimum(np.abs(others) * np.sqrt(2), 1) * 511).astype(np.uint32)
    word = largest.astype(np.uint32)
    for code in (size | (others < 0).astype(np.uint32) << 9).T:
        word = word << 10 | code
    return word.astype("<u4")
