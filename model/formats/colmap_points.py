"""The points of a COLMAP model: `points3D`, binary or text.

Source: COLMAP documentation, "Output Format".
"""

import os
import struct
from pathlib import Path

import numpy as np

from splatcore.model.formats.colmap import colmap_folder, text_lines
from splatcore.model.formats.file import input_error, read_bytes, reading

HEAD = struct.Struct("<Q3d3BdQ")
"""A point: id, x, y, z, r, g, b, error, images that show it; 8 bytes for each of these follow."""

SHOWN = 8
"""Bytes for each image that shows a point."""

Points = tuple[np.ndarray, np.ndarray]
"""Positions [N, 3] (float64, scene units) and colours [N, 3] (uint8)."""


def read_points(path: str | os.PathLike) -> Points:
    """The points of a COLMAP folder (or the one above); InputError names the file and the point."""
    folder = colmap_folder(path)
    for name, reader in (("points3D.bin", _binary), ("points3D.txt", _text)):
        if (folder / name).is_file():
            position, colour = reader(folder / name)
            break
    else:
        raise input_error(folder, "has no points3D.bin or points3D.txt")
    if not len(position):
        raise input_error(folder / name, "holds no points")
    wrong = np.flatnonzero(~np.isfinite(position).all(axis=1))
    if len(wrong):
        raise input_error(folder / name, f"point {wrong[0]} is not finite")
    return position, colour


def _binary(path: Path) -> Points:
    data = read_bytes(path)
    position, colour = [], []
    with reading(path, "is cut off"):
        (count,) = struct.unpack_from("<Q", data)
        offset = 8
        for number in range(count):
            _, x, y, z, red, green, blue, _, shown = HEAD.unpack_from(data, offset)
            offset += HEAD.size + SHOWN * shown
            if offset > len(data):
                raise input_error(path, f"point {number}: {shown} images in {len(data)} bytes")
            position.append((x, y, z))
            colour.append((red, green, blue))
    return np.array(position).reshape(-1, 3), np.array(colour, np.uint8).reshape(-1, 3)


def _text(path: Path) -> Points:
    """Lines of id, x, y, z, r, g, b, error, images."""
    rows = []
    for number, words in enumerate(line.split() for line in text_lines(path)):
        if not words:
            continue
        with reading(f"{path}: point {number}", "line is malformed"):
            rows.append([float(word) for word in words[1:7]])
            if len(rows[-1]) != 6 or not all(0 <= value <= 255 for value in rows[-1][3:]):
                raise ValueError("not x, y, z and a colour")
    table = np.array(rows).reshape(-1, 6)
    return table[:, :3], table[:, 3:].astype(np.uint8)
