"""Cached results of long work: folders and JSON files, named by a hash of their inputs.

They are stored in the user's cache folder, or in the folder that SPLATCORE_CACHE names.
"""

import fcntl
import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from platformdirs import user_cache_path

from splatcore.sim.common.output import write

VARIABLE = "SPLATCORE_CACHE"
"""Environment variable that names the cache folder."""

NAME = r"(library-)?[0-9a-f]{32}(\.json|\.lock)?"
"""Pattern of the names of cached files and folders."""

T = TypeVar("T")


def cache_root() -> Path:
    """Return the cache folder."""
    return Path(os.environ.get(VARIABLE) or user_cache_path("splatcore", False)).absolute()


def kept() -> dict[str, list[Path]]:
    """Return the cached files and folders, by kind. Other names belong to other programs."""
    found = {}
    for kind in sorted(cache_root().glob("*/")):
        if mine := sorted(path for path in kind.iterdir() if re.fullmatch(NAME, path.name)):
            found[kind.name] = mine
    return found


def size_of(path: Path) -> int:
    """Return the bytes of a file, or of all files in a folder."""
    if not path.is_dir():
        return path.stat().st_size
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def empty():
    """Delete everything in the cache; results are rebuilt on demand."""
    for kind, paths in kept().items():
        for path in paths:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        with suppress(OSError):  # holds files of other programs
            (cache_root() / kind).rmdir()


def kept_folder(kind: str, made_from: Any, make: Callable[[Path], None]) -> Path:
    """Return a folder filled by `make`, now or in an earlier run.

    kind: name of the parent folder
    made_from: everything that decides on the content; see `digest`
    make: called with the folder, which may hold files of a failed attempt; an interrupt empties it
    """
    folder = cache_root() / kind / digest(made_from)
    with _locked(folder / "lock"):
        if not (folder / "built").exists():
            try:
                make(folder)
            except KeyboardInterrupt:
                for path in folder.iterdir():
                    if path.name != "lock":  # others may wait for it
                        shutil.rmtree(path) if path.is_dir() else path.unlink()
                raise
            (folder / "built").touch()
    return folder


def kept_json(kind: str, made_from: Any, compute: Callable[[], T]) -> T:
    """Return the result of `compute`, now or in an earlier run, as read back from JSON."""
    path = cache_root() / kind / f"{digest(made_from)}.json"
    with _locked(path.with_suffix(".lock")):
        return kept_in(path, compute)


def kept_in(path: Path, compute: Callable[[], T]) -> T:
    """Return the content of a JSON file; if it is missing or broken, write `compute()` first."""
    with suppress(OSError, ValueError):
        return json.loads(path.read_text())
    path.parent.mkdir(parents=True, exist_ok=True)
    write(path, json.dumps(compute()).encode())
    return json.loads(path.read_text())


def with_key(path: Path, key: str) -> dict | None:
    """Return a JSON file's object if its "key" is `key`; None otherwise, or if unreadable."""
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text())
        return found if isinstance(found, dict) and found.get("key") == key else None


def digest(made_from: Any) -> str:
    """Return a hash of a JSON-like value, with bytes, arrays, dataclasses and paths."""
    text = json.dumps(made_from, default=_plain, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _plain(value: Any) -> Any:
    """Convert a value that JSON does not support."""
    if isinstance(value, bytes):
        return hashlib.sha256(value).hexdigest()
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.shape, _plain(value.tobytes())]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    raise TypeError(f"{type(value).__name__} has no hash: {value!r}")


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock file, as another process may compute the same result."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
