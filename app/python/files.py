"""Writing pictures, models and scenes from Python programs."""

import os
from pathlib import Path

import numpy as np

from splatcore.app.python import check
from splatcore.app.python.frames import pixels
from splatcore.model.export.loss import losses
from splatcore.model.export.writers import find_writer, prepared
from splatcore.model.formats.model_file import file_bytes
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
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
        or [H, W, 4] with alpha and premultiplied colour; model; scene
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
        return write_png(path, pixels("thing", thing, alpha=True))
    _check_own("write", path, thing)
    if isinstance(thing, PackedModel):
        return output.write(path, file_bytes(thing, plain))
    with output.whole_file(path) as part:
        write_ply(part, thing)


def export(path: str | os.PathLike, thing: PackedModel | Scene) -> dict[str, dict[str, float]]:
    """Write a scene or packed model as a scene file for other tools; return the loss.

    path: must end in one of the suffixes in `splatcore export --help`, which is the format
    thing: a model is written as the machine reads it

    Returns the largest error and the root of the mean square, {"largest": …, "rms": …}, of
    "position" (scene units), "scale" (% of the Gaussian's longest axis), "rotation" (degrees),
    "opacity", "colour" (coefficients of degree 0) and, from degree 1 on, "harmonics".

    Gaussians with NaN or Inf are left out. The file is written as a whole or not at all. Raises
    InputError as `write` does.
    """
    path = Path(check.kind("path", path, str, os.PathLike))
    check.kind("thing", thing, PackedModel, Scene)
    writer = find_writer(path)
    output.check_writable(path)
    _check_own("export", path, thing)
    scene, _ = prepared(thing, writer)
    with output.whole_file(path) as part:
        writer.write(part, scene)
        return losses(scene, read_scene(part))


def _check_own(name: str, path: Path, thing: PackedModel | Scene):
    """Raise InputError if a function would overwrite the file that its scene was read from."""
    if thing.name and os.path.isfile(thing.name):
        output.check_distinct([(name, path)], [Path(thing.name)])
