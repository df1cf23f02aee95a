""".splat scenes: 32 bytes per Gaussian, no header. Source: antimatter15/splat, `main.js`."""

import os
from dataclasses import replace

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.file import input_error, read_bytes
from splatcore.spec.colour import SH_C0
from splatcore.spec.scene import Scene

RECORD = np.dtype(
    [("position", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("quaternion", "u1", 4)]
)
"""Scales are linear, in scene units; colours are RGBA; quaternions are (w, x, y, z), with 128 for
0."""


def read(path: str | os.PathLike) -> Scene:
    """Read the scene of a .splat file; SH degree 0."""
    data = read_bytes(path)
    if len(data) % RECORD.itemsize:
        raise input_error(path, f"{len(data)} bytes are not a multiple of {RECORD.itemsize}")
    record = np.frombuffer(data, RECORD)

    def convert(rows: slice) -> Scene:
        some = record[rows]
        colour = some["colour"].astype(np.float64) / 255
        quaternion = (some["quaternion"].astype(np.float64) - 128) / 128
        sh = ((colour[:, :3] - 0.5) / SH_C0)[:, None, :]
        return Scene(some["position"], some["scale"], quaternion, colour[:, 3], sh, os.fspath(path))

    scene = file.in_batches(len(record), convert)
    scale, notes = file.unsigned(scene.scale)
    return replace(scene, scale=scale, notes=notes)
