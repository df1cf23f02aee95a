"""Common parts of all file readers: opening, limits, checked JSON, a scene's arrays."""

import json
import math
import mmap
import os
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.need import check_need
from splatcore.spec.scene import ARRAYS, Scene, batches, sh_count
from splatcore.spec.threads import in_threads

GZIP_MAGIC = b"\x1f\x8b\x08"
"""Begins a gzip stream: SPZ of versions 1 to 3, and PLY as some tools write it."""

EXPANSION_MAX = 1032
"""Largest accepted ratio of decoded bytes to bytes of a file: the limit of deflate itself."""


def input_error(where: object, message: object) -> InputError:
    """An exception with the one-line message `where: message`; line breaks are replaced."""
    return InputError(" ".join(f"{where}: {message}".splitlines()))


@contextmanager
def reading(where: object, fault: str = "cannot be read") -> Iterator[None]:
    """Context for calls of a library: any exception that it raises becomes an InputError."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # the library's own choice, MemoryError and RecursionError included
        reason = str(error)[:200] or type(error).__name__
        raise input_error(where, f"{fault} ({reason})") from error


def file_size(path: str | os.PathLike) -> int:
    """Size in bytes of a regular, non-empty file; raises InputError for anything else."""
    try:
        status = os.stat(path)
    except (OSError, ValueError) as error:
        raise input_error(path, getattr(error, "strerror", None) or error) from error
    if stat.S_ISDIR(status.st_mode):
        raise input_error(path, "is a directory")
    if not stat.S_ISREG(status.st_mode):
        raise input_error(path, "is not a regular file")
    if status.st_size == 0:
        raise input_error(path, "is empty")
    return status.st_size


def read_bytes(path: str | os.PathLike, count: int = -1) -> bytes:
    """Read the first `count` bytes of a file (default: all)."""
    file_size(path)
    with reading(path), open(path, "rb") as file:
        return file.read(count)


def mapped(path: str | os.PathLike) -> mmap.mmap:
    """Map a file into memory; its pages are read when they are used and can be dropped again."""
    file_size(path)
    with reading(path), open(path, "rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def check_count(count: int, where: object, degree: int = 0) -> None:
    """Raise InputError for a scene without Gaussians, and for one that does not fit in memory.

    degree: of its harmonics, if that is known yet
    """
    if count < 1:
        raise input_error(where, f"holds {count} Gaussians")
    check_need("reading", count, degree, str(where))


def check_expansion(size: int, stored: int, where: object) -> None:
    """Raise InputError if `stored` bytes of a file cannot decode to `size` bytes."""
    if size > EXPANSION_MAX * stored:
        raise input_error(where, f"claims {size} bytes of data, too many for {stored} bytes")


def check_degree(degree: int, count: int, size: int, rest: int, where: object) -> None:
    """Raise InputError if `rest` bytes after the last Gaussian are the SH of a higher degree.

    degree: the degree that the file claims
    count: number of Gaussians
    size: bytes per coefficient

    Other numbers of bytes are allowed.
    """
    for held in range(degree + 1, SH_DEGREE_MAX + 1):
        if rest == 3 * size * count * (sh_count(held) - sh_count(degree)):
            raise input_error(where, f"claims SH degree {degree} but holds degree {held}")


def surplus(count: int) -> tuple[str, ...]:
    """A note on the `count` bytes of a file that belong to no Gaussian, if any."""
    return (f"{count} bytes belong to no Gaussian and are not read",) if count else ()


def parse_json(data: bytes, where: object) -> object:
    """Parse a JSON text; NaN and Infinity, which are not JSON, raise InputError."""

    def refuse(constant: str):
        raise ValueError(f"{constant} is not JSON")

    with reading(where, "is not valid JSON"):
        return json.loads(data, parse_constant=refuse)


_KINDS = {dict: "an object", list: "a list", str: "a string", int: "an integer", float: "a number"}


def checked(value: object, kind: type, where: object) -> object:
    """Return `value` if it has the type `kind`: dict, list, str, int or float (finite).

    An integral float is accepted as int, an int as float, a boolean as neither. `where` names the
    value at the start of the message of an InputError.
    """
    if kind in (int, float) and type(value) in (int, float):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isfinite(number) and (kind is float or number.is_integer()):
            return kind(value)
    elif kind not in (int, float) and isinstance(value, kind):
        return value
    shown = repr(value)
    shown = shown if len(shown) <= 40 else shown[:40] + "…"
    raise input_error(where, f"is {shown}, not {_KINDS[kind]}")


def field(table: dict, name: str, kind: type, where: object, default: object = None) -> object:
    """Return `table[name]`, checked to have the type `kind`; it may be missing if `default` is
    given."""
    if name in table:
        return checked(table[name], kind, f"{where}: {name!r}")
    if default is None:
        raise input_error(where, f"{name!r} is missing")
    return default


def array_field(table: dict, name: str, shape: tuple[int, ...], where: object) -> np.ndarray:
    """Return `table[name]`, nested lists of finite numbers, as float64 of `shape`; () is a single
    number."""
    value, where = field(table, name, object, where), f"{where}: {name!r}"

    def flat(item: object, sides: tuple[int, ...]) -> list[float]:
        if not sides:
            return [checked(item, float, where)]
        if len(checked(item, list, where)) != sides[0]:
            raise input_error(where, f"has {len(item)} entries, not {sides[0]}")
        return [number for part in item for number in flat(part, sides[1:])]

    return np.array(flat(value, shape), np.float64).reshape(shape)


def unsigned(scale: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Linear scales [N, 3] without their signs, which covariances do not have, and a note on
    negative ones, if any."""
    negative = int((scale < 0).any(axis=1).sum())
    s = "s" * (negative > 1)
    notes = (f"{negative} Gaussian{s} with a negative scale, sign dropped",) if negative else ()
    return np.abs(scale), notes


@contextmanager
def copied(content: bytes, suffix: str, where: object) -> Iterator[str]:
    """Yield the path of a temporary file with this content, for a library that reads files alone.

    An InputError inside that names the copy names `where` instead.
    """
    with reading(where), tempfile.NamedTemporaryFile(suffix=suffix) as copy:
        copy.write(content)
        copy.flush()
        try:
            yield copy.name
        except InputError as error:
            raise InputError(str(error).replace(copy.name, str(where))) from None


def sigmoid(x: np.ndarray) -> np.ndarray:
    """1/(1 + e^−x), which converts stored opacities to 0 … 1. NaN stays NaN."""
    return 0.5 * (1 + np.tanh(0.5 * np.asarray(x, np.float64)))


def stored_scene(
    path: str | os.PathLike,
    position: np.ndarray,  # [N, 3]
    log_scale: np.ndarray,  # [N, 3] natural logarithms; beyond 709 the scale is Inf
    quaternion: np.ndarray,  # [N, 4]
    opacity: np.ndarray,  # [N]
    constant: np.ndarray,  # [N, 3] SH coefficients of degree 0
    higher: np.ndarray | None = None,  # [N, 3 | 8 | 15, 3] coefficients of higher degrees
) -> Scene:
    """Make the scene of a file that stores logarithms of scales; its name is `path`."""
    sh = constant[:, None, :]
    if higher is not None:
        sh = np.concatenate([sh, higher], axis=1)
    scale = np.exp(np.asarray(log_scale, np.float64))
    return Scene(position, scale, quaternion, opacity, sh, os.fspath(path))


def in_batches(count: int, read: Callable[[slice], Scene]) -> Scene:
    """Join the scenes that `read` returns for batches of `count` ≥ 1 rows; all but the arrays is
    the first one's. So intermediate arrays are never as long as the scene."""
    arrays, first = {}, None
    for rows, scene in zip(batches(count), in_threads(read, count), strict=True):
        if len(scene) == count:
            return scene
        first = first or scene
        for name in ARRAYS:
            some = getattr(scene, name)
            if name not in arrays:
                arrays[name] = np.empty((count, *some.shape[1:]), some.dtype)
            arrays[name][rows] = some
    return replace(first, **arrays)


def linear_scene(
    path: str | os.PathLike,
    position: np.ndarray,  # [N, 3]
    scale: np.ndarray,  # [N, 3] not logarithms
    quaternion: np.ndarray,  # [N, 4]
    opacity: np.ndarray,  # [N], 0 … 1
    sh: np.ndarray,  # [N, K, 3]
    notes: tuple[str, ...] = (),
) -> Scene:
    """Make the scene of a file that stores scales and opacities as they are; its name is `path`.

    A negative scale gives the covariance of its absolute value. Opacities are clipped to 0 … 1.
    """
    scale, negative = unsigned(scale)
    notes += negative
    beyond = int(((opacity < 0) | (opacity > 1)).sum())
    if beyond:
        s = "ies" if beyond > 1 else "y"
        notes += (f"{beyond} opacit{s} outside 0 … 1, clipped",)
    opacity = np.clip(opacity, 0, 1)
    return Scene(position, scale, quaternion, opacity, sh, os.fspath(path), notes)
