"""Reads a scene file of any format that this project knows."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from splatcore.model.formats.file import input_error, read_bytes
from splatcore.model.formats.ply import read_ply
from splatcore.model.formats.sog import read_sog
from splatcore.model.formats.splat import read_splat
from splatcore.model.formats.spz import GZIP_MAGIC, SPZ_MAGIC, read_spz
from splatcore.spec.scene import Scene

READERS = {
    b"ply\n": read_ply,
    b"ply\r": read_ply,
    SPZ_MAGIC: read_spz,
    GZIP_MAGIC: read_spz,
    b"PK\x03\x04": read_sog,
}
"""First bytes of a file → its reader. A .splat file has no such bytes and needs its extension."""

NORM_RANGE = (1e-3, 1e3)
"""Norms of quaternions that need no note: training does not normalise them."""


def read_scene(path: str | os.PathLike) -> Scene:
    """The scene of a PLY, compressed PLY, SPZ, SOG or .splat file; its `name` is `path`.

    `notes` count what is odd in it. Raises InputError for any other or malformed file.
    """
    start = read_bytes(path, 4)
    reader = next((READERS[magic] for magic in READERS if start.startswith(magic)), None)
    if reader is None and Path(path).suffix.lower() != ".splat":
        raise input_error(path, "is no PLY, SPZ, SOG or .splat file")
    with np.errstate(all="ignore"):  # NaN and Inf may occur; the notes say so, not warnings
        scene = (reader or read_splat)(path)
        return replace(scene, notes=scene.notes + _notes(scene))


def _notes(scene: Scene) -> tuple[str, ...]:
    """A line for each kind of odd Gaussian, with how many there are."""
    arrays = (scene.position, scene.scale, scene.quaternion, scene.opacity, scene.sh)
    finite = np.ones(len(scene), bool)
    for array in arrays:
        finite &= np.isfinite(array).reshape(len(scene), -1).all(axis=1)
    norm = np.linalg.norm(scene.quaternion[finite], axis=1)
    low, high = NORM_RANGE
    counts = {
        "Gaussians with NaN or Inf": np.sum(~finite),
        "quaternions of norm 0": np.sum(norm == 0),
        f"quaternions of a norm beyond {low:g} … {high:g}": np.sum(
            (norm > 0) & ((norm < low) | (norm > high))
        ),
    }
    return tuple(f"{count} {what}" for what, count in counts.items() if count)
