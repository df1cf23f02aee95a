"""The scene formats that can be written, by the suffix of the file."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatcore.model.export import sog, spz
from splatcore.model.export.unpacked import unpacked
from splatcore.model.formats.file import input_error
from splatcore.model.formats.gltf_write import write_glb
from splatcore.model.formats.ply import write_compressed_ply, write_ply
from splatcore.model.pack.chunk import MORTON_BITS, morton_order
from splatcore.model.pack.stored import keep
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene, without_zero


class Writer(NamedTuple):
    """A format that is written."""

    name: str
    write: Callable[[str | os.PathLike, Scene], None]
    sort: bool = False  # along a curve: neighbours share bounds, or compress better as pixels


WRITERS = {
    ".compressed.ply": Writer("compressed PLY", write_compressed_ply, sort=True),
    ".ply": Writer("PLY", write_ply),
    ".glb": Writer("GLB", write_glb),
    ".spz": Writer("SPZ 4", spz.write),
    ".sog": Writer("SOG 2", sog.write, sort=True),
}
"""The formats by suffix; the first suffix with which a file's name ends holds."""


def find_writer(path: str | os.PathLike) -> Writer:
    """Return the format that a file's suffix names; raises InputError for an unknown one."""
    for suffix, writer in WRITERS.items():
        if Path(path).name.lower().endswith(suffix):
            return writer
    *suffixes, last = WRITERS
    raise input_error(path, f"must end in {', '.join(suffixes)} or {last}")


def prepared(source: Scene | PackedModel, writer: Writer) -> tuple[Scene, str]:
    """Return the scene that is written for a scene or model, in the file's order, and a note on
    Gaussians that are left out, or an empty text.

    Gaussians with NaN or Inf are left out: in compressed formats they would spoil others.
    Quaternions are normalised; 0, which stands for no rotation, becomes (1, 0, 0, 0).
    """
    scene = unpacked(source) if isinstance(source, PackedModel) else source
    finite, _ = keep(scene)
    scene, lost = scene[finite], int((~finite).sum())
    if not len(scene):
        raise input_error(scene.name, "holds no Gaussian that can be exported")
    quaternion = without_zero(scene.quaternion)
    unit = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    scene = replace(scene, quaternion=unit)
    if writer.sort:
        scene = scene[curve_order(scene.position)]
    s = "s" * (lost != 1)
    return scene, f"{lost} Gaussian{s} with NaN or Inf left out" if lost else ""


def curve_order(position: np.ndarray) -> np.ndarray:
    """Return the order [N] of positions [N, 3] along the Morton curve of their bounding box."""
    low = position.min(axis=0)
    span = max((position - low).max(), np.finfo(np.float64).tiny)
    grid = (position - low) / span * ((1 << MORTON_BITS) - 1)
    return morton_order(grid.astype(np.int64))
