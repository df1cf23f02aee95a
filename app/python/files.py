"""Writing pictures, models and scenes from Python programs."""

import os
from pathlib import Path

import numpy as np

from splatcore.app.python import check
from splatcore.app.python.frames import pixels
from splatcore.model.formats.model_file import file_bytes
from splatcore.model.formats.ply import write_ply
from splatcore.sim.common import output
from splatcore.sim.frame.picture import write_png
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

SUFFIXES = {np.ndarray: ".png", PackedModel: ".splatcore", Scene: ".ply"}
"""File suffixes by content."""


def write(path: str | os.PathLike, thing: np.ndarray | PackedModel | Scene, plain: bool = False):
    """Write a picture, a packed model or a scene.

    path: must end in .png, .splatcore or .ply (3DGS), respectively
    thing: the picture [H, W, 3] (uint8, or float with 1 for white, clipped and rounded to 8 bits),
        model or scene
    plain: write the plain bytes of DRAM instead of a coded file; for models only

    The file is written as a whole or not at all; an existing one is replaced, except the file that
    the scene or model was read from. Raises InputError, naming the file, for a wrong suffix, a
    folder that does not exist, or a file that cannot be written.
    """
    path = Path(check.kind("path", path, str, os.PathLike))
    check.kind("thing", thing, *SUFFIXES)
    suffix = next(end for kind, end in SUFFIXES.items() if isinstance(thing, kind))
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: must end in {suffix}")
    if plain and suffix != SUFFIXES[PackedModel]:
        raise InputError("plain: is for packed models only")
    output.check_writable(path)
    if isinstance(thing, np.ndarray):
        return write_png(path, pixels("thing", thing))
    if thing.name and os.path.isfile(thing.name):
        output.check_distinct([("write", path)], [Path(thing.name)])
    if isinstance(thing, PackedModel):
        return output.write(path, file_bytes(thing, plain))
    with output.whole_file(path) as part:
        write_ply(part, thing)
