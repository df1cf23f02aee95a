"""Files of pictures, models and scenes that Python programs write."""

import os
from pathlib import Path

import numpy as np

from splatcore.model.formats.model_file import file_bytes
from splatcore.model.formats.ply import write_ply
from splatcore.sim.common import output
from splatcore.sim.common.picture import write_png
from splatcore.sim.python import check
from splatcore.sim.python.frames import pixels
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

SUFFIXES = {np.ndarray: ".png", PackedModel: ".splatcore", Scene: ".ply"}
"""Ends of files by what they hold."""


def write(path: str | os.PathLike, thing: np.ndarray | PackedModel | Scene, plain: bool = False):
    """Write a picture (.png), a packed model (.splatcore) or a scene (3DGS .ply) as a whole file.

    A model's file is coded, `plain`: the bytes of memory as they are, for what loads them itself.
    A picture [H, W, 3] is uint8, or float with 1 for white, clipped and rounded to 8 bits. A file
    that is there is replaced, but not the one that a scene or model was read from. InputError,
    naming the file, for another end, a folder that is not there, and what cannot be written.
    """
    path = Path(check.kind("path", path, str, os.PathLike))
    check.kind("thing", thing, *SUFFIXES)
    suffix = next(end for kind, end in SUFFIXES.items() if isinstance(thing, kind))
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: does not end with {suffix}, as files of its content do")
    if plain and suffix != SUFFIXES[PackedModel]:
        raise InputError("plain: is for packed models")
    output.check_writable(path)
    if isinstance(thing, np.ndarray):
        return write_png(path, pixels("thing", thing))
    if thing.name and os.path.isfile(thing.name):
        output.check_distinct([("write", path)], [Path(thing.name)])
    if isinstance(thing, PackedModel):
        return output.write(path, file_bytes(thing, plain))
    with output.whole_file(path) as part:
        write_ply(part, thing)
