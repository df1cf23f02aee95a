"""Reads a scene file of any format that this project knows."""

import os
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np

from splatcore.model.formats import ply, sog, splat, spz
from splatcore.model.formats.file import input_error, read_bytes
from splatcore.spec.scene import Scene

FORMATS = {"PLY": ply, "SPZ": spz, "SOG": sog, ".splat": splat}
"""Name for messages → module; those that know a file by its first bytes stand first.

`matches(start, suffix)`: true for the format's files, from their first four bytes and the end of
their name in lower case. `read(path)`: the `Scene` of such a file; an InputError, which names file
and field, for a malformed one. NaN and Inf may stay, numpy's warnings about them are silenced.
"""

TRAINED = "point_cloud/iteration_*/point_cloud.ply"
"""Scenes in the folder that INRIA's training writes."""

NORM_RANGE = (1e-3, 1e3)  # norms of quaternions that need no note: training does not normalise them


def read_scene(path: str | os.PathLike) -> Scene:
    """The scene of a file of any of `FORMATS`, of a compressed PLY or of a folder as INRIA's
    training leaves it; its `name` is the file's path.

    `notes` count what is odd in it. Raises InputError for any other or malformed file.
    """
    file = scene_file(path)
    format = find_format(file)
    with np.errstate(all="ignore"):  # NaN and Inf are noted instead
        scene = format.read(file)
        return replace(scene, notes=scene.notes + _notes(scene))


def scene_file(path: str | os.PathLike) -> str | os.PathLike:
    """The file of a scene: of a folder as INRIA's training leaves it that of the last iteration."""
    if not os.path.isdir(path):
        return path
    found = {
        int(number[1]): file
        for file in Path(path).glob(TRAINED)
        if (number := re.fullmatch(r"iteration_(\d+)", file.parent.name))
    }
    if not found:
        raise input_error(path, f"is a directory without {TRAINED.replace('*', 'N')}")
    return found[max(found)]


def find_format(path: str | os.PathLike) -> ModuleType:
    """The module of `FORMATS` that knows a file; InputError if none does."""
    path = scene_file(path)
    start, suffix = read_bytes(path, 4), Path(path).suffix.lower()
    for format in FORMATS.values():
        if format.matches(start, suffix):
            return format
    *names, last = FORMATS
    raise input_error(path, f"is no {', '.join(names)} or {last} file")


def _notes(scene: Scene) -> tuple[str, ...]:
    """A line for each kind of odd Gaussian, with how many there are."""
    arrays = (scene.position, scene.scale, scene.quaternion, scene.opacity, scene.sh)
    finite = np.all([np.isfinite(each).reshape(len(scene), -1).all(axis=1) for each in arrays], 0)
    norm = np.linalg.norm(scene.quaternion[finite], axis=1)
    low, high = NORM_RANGE
    odd = (norm > 0) & ((norm < low) | (norm > high))
    counts = {
        "Gaussians with NaN or Inf": np.sum(~finite),
        "quaternions of norm 0": np.sum(norm == 0),
        f"quaternions of a norm beyond {low:g} … {high:g}": np.sum(odd),
    }
    return tuple(f"{count} {what}" for what, count in counts.items() if count)
