"""Reading scene files of all supported formats."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatcore.model.formats import gltf, ply, sog, splat, spz, usd
from splatcore.model.formats.file import input_error, read_bytes
from splatcore.model.formats.gltf_file import GLB_MAGIC
from splatcore.model.formats.harmonics import directions, harmonics
from splatcore.spec.colour import COLOUR_INTEGER, SH_C0
from splatcore.spec.convention import ALPHA_MIN, COLOUR_OFFSET
from splatcore.spec.scene import ARRAYS, Scene


class Format(NamedTuple):
    """A format of scene files, known by its first bytes, or by an extension if it has no mark."""

    name: str  # for messages
    read: Callable[..., Scene]
    starts: tuple[bytes, ...] = ()  # of up to four bytes
    suffix: str | None = None  # in lower case
    axes: bool = False  # `read` takes the axes of a file that does not state them


FORMATS = (
    Format("PLY", ply.read, (b"ply\n", b"ply\r")),
    Format("SPZ", spz.read, (spz.SPZ_MAGIC, spz.GZIP_MAGIC), axes=True),
    Format("glTF", gltf.read, (GLB_MAGIC,), ".gltf", axes=True),
    Format("USD", usd.read, usd.STARTS, ".usdz", axes=True),  # before SOG: a usdz is a zip, too
    Format("SOG", sog.read, (b"PK\x03\x04",)),
    Format(".splat", splat.read, suffix=".splat"),
)
"""The formats, in the order in which they are tried.

`read(path)` returns the scene of a file, or raises InputError naming file and field. The scene may
hold NaN and Inf; the caller silences numpy's warnings about them.
"""

CHOICE = "SPZ, glTF and USD"
"""Formats whose files may leave their axes to the reader."""

TRAINED = "point_cloud/iteration_*/point_cloud.ply"
"""Scenes in the output folder of INRIA's training."""

NORM_RANGE = (1e-3, 1e3)  # usual norms of quaternions, which training does not normalise


def read_scene(path: str | os.PathLike, axes: str | None = None) -> Scene:
    """Read a scene; its `name` is the file's path, its `notes` count unusual Gaussians.

    path: file of any of `FORMATS`, or output folder of INRIA's training
    axes: one of `spz_axes.AXES`, for a file that does not state its axes: SPZ, also inside glTF
        (default: RUB), and USD (default: RDF)

    Raises InputError for an unknown format, a malformed file, and axes for a file whose axes are
    known.
    """
    file = scene_file(path)
    format = find_format(file)
    check_axes(file, axes)
    with np.errstate(all="ignore"):  # NaN and Inf are noted instead
        scene = format.read(file, axes) if axes else format.read(file)
        return replace(scene, notes=scene.notes + _notes(scene))


def check_axes(path: str | os.PathLike, axes: str | None):
    """Raise InputError if axes are given for a file of a format without a choice of them."""
    if axes and not find_format(path).axes:
        raise input_error(path, f"--axes {axes}: only {CHOICE} files have a choice of axes")


def scene_file(path: str | os.PathLike) -> str | os.PathLike:
    """The file of a scene; in an output folder of INRIA's training, that of the last iteration."""
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


def find_format(path: str | os.PathLike) -> Format:
    """The format of a file; raises InputError for an unknown one."""
    path = scene_file(path)
    start, suffix = read_bytes(path, 4), Path(path).suffix.lower()
    for format in FORMATS:
        if start.startswith(format.starts) or suffix == format.suffix:
            return format
    *names, last = (format.name for format in FORMATS)
    raise input_error(path, f"is not a {', '.join(names)} or {last} file")


COLOUR_MAX = 2.0**COLOUR_INTEGER
"""Colours of at least this saturate in the machine."""

LOOKS = 200  # directions, evenly over the sphere, in which bright Gaussians are evaluated


def _notes(scene: Scene) -> tuple[str, ...]:
    """A line per kind of unusual Gaussian, with their number."""
    arrays = [getattr(scene, name).reshape(len(scene), -1) for name in ARRAYS]
    kept = scene
    if not np.isfinite([(array.min(), array.max()) for array in arrays]).all():
        kept = scene[np.all([np.isfinite(array).all(axis=1) for array in arrays], axis=0)]
    norm = np.sqrt(np.einsum("nk,nk->n", kept.quaternion, kept.quaternion))
    low, high = NORM_RANGE
    odd = (norm > 0) & ((norm < low) | (norm > high))
    counts = {
        "Gaussian{s} with NaN or Inf": len(scene) - len(kept),
        "quaternion{s} of norm 0": np.sum(norm == 0),
        f"quaternion{{s}} of a norm outside {low:g} … {high:g}": np.sum(odd),
        "transparent Gaussian{s} (opacity below 1/255)": np.sum(kept.opacity < ALPHA_MIN),
        f"Gaussian{{s}} with colours from {COLOUR_MAX:g} on, which saturate in the machine": (
            _saturating(kept.sh)
        ),
    }
    return tuple(
        f"{count} {kind.format(s='' if count == 1 else 's')}"
        for kind, count in counts.items()
        if count
    )


def _saturating(sh: np.ndarray) -> int:
    """Number of Gaussians that reach `COLOUR_MAX` in a channel in any of `LOOKS` directions.

    With K coefficients per channel, harmonics beyond the constant one add at most the norm of their
    coefficients times √((K − 1) / 4π). This bound rules out most Gaussians.
    """
    if not len(sh):
        return 0
    most = np.sqrt((sh.shape[1] - 1) / (4 * np.pi))
    norm = np.sqrt(np.einsum("nkc,nkc->nc", sh[:, 1:], sh[:, 1:]))
    reach = COLOUR_OFFSET + SH_C0 * sh[:, 0] + most * norm
    bright = sh[(reach >= COLOUR_MAX).any(axis=1)]
    found, basis = 0, harmonics(directions(LOOKS), int(np.sqrt(sh.shape[1])) - 1)
    for some in np.array_split(bright, len(bright) // 4096 + 1):
        colour = COLOUR_OFFSET + np.einsum("dk,nkc->ndc", basis, some)
        found += int((colour >= COLOUR_MAX).any(axis=(1, 2)).sum())
    return found
