"""Shared by all readers of files from outside: opening, limits, checked JSON, a scene's arrays."""

import json
import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene, sh_count

EXPANSION_MAX = 1032
"""Decoded bytes per byte of a file that a reader accepts: the limit of deflate itself."""


def input_error(where: object, message: object) -> InputError:
    """The exception to raise: one line `where: message`, whatever line breaks the parts hold."""
    return InputError(" ".join(f"{where}: {message}".splitlines()))


@contextmanager
def reading(where: object, what: str = "cannot be read") -> Iterator[None]:
    """Wraps calls of a library: whatever it raises on a bad file becomes an InputError."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # the library's own choice, MemoryError and RecursionError included
        reason = str(error)[:200] or type(error).__name__
        raise input_error(where, f"{what} ({reason})") from error


def file_size(path: str | os.PathLike) -> int:
    """Size in bytes of a regular, non-empty file; an InputError for anything else."""
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
    """The first `count` bytes of a file, by default all of them."""
    file_size(path)
    with reading(path), open(path, "rb") as file:
        return file.read(count)


def check_count(count: int, where: object) -> None:
    """Refuses a scene without Gaussians."""
    if count < 1:
        raise input_error(where, f"holds {count} Gaussians")


def check_expansion(size: int, stored: int, where: object) -> None:
    """Refuses `size` decoded bytes that `stored` bytes of a file cannot hold."""
    if size > EXPANSION_MAX * stored:
        raise input_error(where, f"claims {size} bytes of data, too many for {stored} bytes")


def check_degree(degree: int, count: int, size: int, rest: int, where: object) -> None:
    """Refuses `rest` bytes after the last Gaussian that are the SH of a degree above the one that
    the file claims: `count` Gaussians, `size` bytes a coefficient. Other bytes may follow.
    """
    for held in range(degree + 1, SH_DEGREE_MAX + 1):
        if rest == 3 * size * count * (sh_count(held) - sh_count(degree)):
            raise input_error(where, f"claims SH degree {degree}, holds {held}")


def surplus(count: int) -> tuple[str, ...]:
    """A note on bytes of a file that belong to no Gaussian, if there are any."""
    return (f"{count} bytes belong to no Gaussian and are not read",) if count else ()


def parse_json(data: bytes, where: object) -> object:
    """The value of a JSON text; NaN and Infinity, which JSON does not have, are refused."""

    def refuse(constant: str):
        raise ValueError(f"{constant} is not JSON")

    with reading(where, "is not valid JSON"):
        return json.loads(data, parse_constant=refuse)


_KINDS = {dict: "an object", list: "a list", str: "a string", int: "an integer", float: "a number"}


def checked(value: object, kind: type, where: object) -> object:
    """`value` if it is of `kind`: dict, list, str, int or float (finite).

    An integral float passes as int, an int as float; a boolean as neither. `where` starts the
    message and names the value.
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
    """`table[name]`, checked to be of `kind`; it may be missing if there is a default."""
    if name in table:
        return checked(table[name], kind, f"{where}: {name!r}")
    if default is None:
        raise input_error(where, f"{name!r} is missing")
    return default


def array_field(table: dict, name: str, shape: tuple[int, ...], where: object) -> np.ndarray:
    """`table[name]`, nested lists of finite numbers, as float64 of `shape`; () is a lone number."""
    value, where = field(table, name, object, where), f"{where}: {name!r}"

    def flat(item: object, sides: tuple[int, ...]) -> list[float]:
        if not sides:
            return [checked(item, float, where)]
        if len(checked(item, list, where)) != sides[0]:
            raise input_error(where, f"has {len(item)} entries, not {sides[0]}")
        return [number for part in item for number in flat(part, sides[1:])]

    return np.array(flat(value, shape), np.float64).reshape(shape)


def sigmoid(x: np.ndarray) -> np.ndarray:
    """1/(1 + e^−x): a stored opacity to [0, 1]. NaN passes through."""
    return 0.5 * (1 + np.tanh(0.5 * np.asarray(x, np.float64)))


def stored_scene(
    path: str | os.PathLike,
    position: np.ndarray,  # [N, 3]
    log_scale: np.ndarray,  # [N, 3] natural logarithms; beyond 709 the scale is Inf
    quaternion: np.ndarray,  # [N, 4]
    opacity: np.ndarray,  # [N]
    constant: np.ndarray,  # [N, 3] SH coefficients of degree 0
    higher: np.ndarray | None = None,  # [N, 3 | 8 | 15, 3] and those above
) -> Scene:
    """The scene of a file that stores logarithms of scales; its name is `path`."""
    sh = np.asarray(constant, np.float64)[:, None, :]
    if higher is not None:
        sh = np.concatenate([sh, np.asarray(higher, np.float64)], axis=1)
    scale = np.exp(np.asarray(log_scale, np.float64))
    return Scene(position, scale, quaternion, opacity, sh, os.fspath(path))
