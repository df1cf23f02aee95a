"""Reading scene files of all supported formats."""

import gzip
import os
import re
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatcore.model.formats import gltf, ksplat, ply, sog, sog_files, sog_stream, splat, spz, usd
from splatcore.model.formats.file import GZIP_MAGIC, input_error, read_bytes
from splatcore.model.formats.gltf_file import GLB_MAGIC
from splatcore.model.formats.harmonics import directions, harmonics
from splatcore.spec.colour import COLOUR_INTEGER
from splatcore.spec.convention import ALPHA_MIN, COLOUR_OFFSET
from splatcore.spec.scene import ARRAYS, Scene
from splatcore.spec.threads import in_threads


class Format(NamedTuple):
    """A format of scene files, known by its first bytes, or by the end of its name if it has no
    mark."""

    name: str  # for messages
    read: Callable[..., Scene]
    starts: tuple[bytes, ...] = ()  # of up to four bytes
    suffix: str | None = None  # end of the name, in lower case
    axes: bool = False  # `read` takes the axes of a file that does not state them
    lod: bool = False  # `read` takes a level of detail


FORMATS = (
    Format("PLY", ply.read, (b"ply\n", b"ply\r")),
    Format("SPZ", spz.read, (spz.SPZ_MAGIC, GZIP_MAGIC), axes=True),
    Format("glTF", gltf.read, (GLB_MAGIC,), ".gltf", axes=True),
    Format("USD", usd.read, usd.STARTS, ".usdz", axes=True),  # before SOG: a usdz is a zip, too
    Format("SOG", sog.read, (b"PK\x03\x04",)),
    Format("SOG", sog_stream.read, suffix=sog_stream.META, lod=True),
    Format("SOG", sog.read, suffix=sog_files.META),
    Format("KSPLAT", ksplat.read, suffix=".ksplat"),
    Format(".splat", splat.read, suffix=".splat"),
)
"""The formats, in the order in which they are tried.

`read(path)` returns the scene of a file, or raises InputError naming file and field. The scene may
hold NaN and Inf; the caller silences numpy's warnings about them.
"""

CHOICE = "SPZ, glTF and USD"
"""Formats whose files may leave their axes to the reader."""

_ST = "splat-transform {file} scene.ply"
OTHERS = {
    ".lcc": ("an LCC scene of XGRIDS", _ST),
    ".lcc2": ("an LCC 2 scene of XGRIDS", _ST),
    ".mjs": ("a generator for splat-transform", _ST),
    ".spx": ("an SPX scene of Reall3D", "gsbox -i {file} -o scene.ply"),
    ".ssproj": ("a project of SuperSplat", "open it there and export a PLY"),
    ".psht": ("a project of Postshot", "open it there and export a PLY"),
    ".ckpt": ("a checkpoint of nerfstudio", "ns-export gaussian-splat"),
    "tileset.json": ("a 3D Tiles set", "open one of its .glb tiles"),
}
"""Scenes that are known but not read, by the end of their names: name, and how to convert them."""

TRAINED = "point_cloud/iteration_*/point_cloud.ply"
"""Scenes in the output folder of INRIA's training."""

NORM_RANGE = (1e-3, 1e3)  # usual norms of quaternions, which training does not normalise


def read_scene(path: str | os.PathLike, axes: str | None = None, lod: int | None = None) -> Scene:
    """Read a scene; its `name` is the file's path, its `notes` count unusual Gaussians.

    path: file of any of `FORMATS`, folder of an unbundled or streamed SOG, or output folder of
        INRIA's training
    axes: one of `spz_axes.AXES`, for a file that does not state its axes: SPZ, also inside glTF
        (default: RUB), and USD (default: RDF)
    lod: level of detail of a streamed SOG (default: 0, the finest)

    Raises InputError for an unknown format, a malformed file, axes for a file whose axes are known,
    and a level of detail for a file without them.
    """
    file = scene_file(path)
    format = check_choices(file, axes, lod)
    choices = [choice for choice in (axes, lod) if choice is not None]
    with np.errstate(all="ignore"):  # NaN and Inf are noted instead
        scene = format.read(file, *choices)
        return replace(scene, notes=scene.notes + _notes(scene))


def check_choices(path: str | os.PathLike, axes: str | None, lod: int | None) -> Format:
    """Return the format of a file; raises InputError if axes or a level are given for a format
    without this choice."""
    format = find_format(path)
    if axes and not format.axes:
        raise input_error(path, f"--axes {axes}: only {CHOICE} files have a choice of axes")
    if lod is not None and not format.lod:
        raise input_error(path, f"--lod {lod}: only a streamed SOG has levels of detail")
    return format


def scene_file(path: str | os.PathLike) -> str | os.PathLike:
    """The file of a scene; in an output folder of INRIA's training, that of the last iteration; in
    a folder of SOG, its JSON file."""
    if not os.path.isdir(path):
        return path
    found = {
        int(number[1]): file
        for file in Path(path).glob(TRAINED)
        if (number := re.fullmatch(r"iteration_(\d+)", file.parent.name))
    }
    if found:
        return found[max(found)]
    metas = sog_stream.META, sog_files.META
    for name in metas:
        if os.path.exists(file := Path(path, name)):
            return file
    for suffix in OTHERS:
        if file := next(Path(path).glob(f"*{suffix}"), None):
            return file
    names = ", ".join((TRAINED.replace("*", "N"), *metas))
    raise input_error(path, f"is a directory without any of {names}")


def find_format(path: str | os.PathLike) -> Format:
    """The format of a file; raises InputError for an unknown one."""
    path = scene_file(path)
    start, name = _start(path), os.path.basename(path).lower()
    for suffix, (kind, way) in OTHERS.items():
        if name.endswith(suffix):
            to_do = way.format(file=os.path.basename(path))
            raise input_error(path, f"is {kind}, which is not read; convert it: {to_do}")
    for format in FORMATS:
        if start.startswith(format.starts) or (format.suffix and name.endswith(format.suffix)):
            return format
    *names, last = dict.fromkeys(format.name for format in FORMATS)
    raise input_error(path, f"is not a {', '.join(names)} or {last} file")


def _start(path: str | os.PathLike) -> bytes:
    """The first four bytes of a file, or those of a PLY in its gzip stream."""
    start = read_bytes(path, 4)
    if start.startswith(GZIP_MAGIC):
        with suppress(OSError, EOFError, zlib.error), gzip.open(path) as stream:
            if (inside := stream.read(4)).startswith(b"ply"):
                return inside
    return start


COLOUR_MAX = 2.0**COLOUR_INTEGER
"""Colours of at least this saturate in the machine."""

LOOKS = 200  # directions, evenly over the sphere, in which bright Gaussians are evaluated


def _notes(scene: Scene) -> tuple[str, ...]:
    """A line per kind of unusual Gaussian, with their number."""
    low, high = NORM_RANGE
    kinds = (
        "Gaussian{s} with NaN or Inf",
        "quaternion{s} of norm 0",
        f"quaternion{{s}} of a norm outside {low:g} … {high:g}",
        "transparent Gaussian{s} (opacity below 1/255)",
        f"Gaussian{{s}} with colours from {COLOUR_MAX:g} on, which saturate in the machine",
    )
    found = in_threads(lambda rows: _unusual(scene[rows]), len(scene))
    counts = sum(found, np.zeros(len(kinds), int))
    return tuple(
        f"{count} {kind.format(s='' if count == 1 else 's')}"
        for count, kind in zip(counts, kinds, strict=True)
        if count
    )


def _unusual(scene: Scene) -> np.ndarray:
    """The number of Gaussians of each kind of `_notes`."""
    arrays = [getattr(scene, name).reshape(len(scene), -1) for name in ARRAYS]
    kept = scene
    if not np.isfinite([(array.min(), array.max()) for array in arrays]).all():
        kept = scene[np.all([np.isfinite(array).all(axis=1) for array in arrays], axis=0)]
    norm = np.sqrt(np.einsum("nk,nk->n", kept.quaternion, kept.quaternion))
    low, high = NORM_RANGE
    odd = (norm > 0) & ((norm < low) | (norm > high))
    transparent = np.sum(kept.opacity < ALPHA_MIN)
    saturating = _saturating(kept.sh)
    lost = len(scene) - len(kept)
    return np.array([lost, np.sum(norm == 0), np.sum(odd), transparent, saturating])


def _saturating(sh: np.ndarray) -> int:
    """Number of Gaussians that reach `COLOUR_MAX` in a channel in any of `LOOKS` directions.

    With K coefficients per channel, a colour is within their norm times √(K / 4π) of the offset.
    Only Gaussians whose norm over all channels allows for `COLOUR_MAX`, less 0.1 % for float32,
    are evaluated.
    """
    count = sh.shape[1]
    flat = sh.reshape(len(sh), 3 * count)
    least = 0.999 * (COLOUR_MAX - COLOUR_OFFSET) / np.sqrt(count / (4 * np.pi))
    bright = sh[np.einsum("nk,nk->n", flat, flat) >= least**2].astype(np.float64)
    found, basis = 0, harmonics(directions(LOOKS), int(np.sqrt(count)) - 1)
    for some in np.array_split(bright, len(bright) // 128 + 1) if len(bright) else ():
        colour = COLOUR_OFFSET + np.einsum("dk,nkc->ndc", basis, some)
        found += int((colour >= COLOUR_MAX).any(axis=(1, 2)).sum())
    return found
