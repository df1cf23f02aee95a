"""Cached results of long work: folders named by a hash of everything that decides their content.

They are stored in the user's cache folder, or in the folder that SPLATCORE_CACHE names.
"""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

VARIABLE = "SPLATCORE_CACHE"
"""Environment variable that names the cache folder."""


def cache_root() -> Path:
    """Return the cache folder."""
    if named := os.environ.get(VARIABLE):
        return Path(named).absolute()
    from platformdirs import user_cache_path

    return user_cache_path("splatcore", False).absolute()


def kept_folder(kind: str, made_from: Any, make: Callable[[Path], None]) -> Path:
    """Return a folder filled by `make`, now or in an earlier run.

    kind: name of the parent folder
    made_from: everything that decides on the content; see `digest`
    make: called with the folder, which may hold files of a failed attempt; an interrupt empties it
    """
    folder = cache_root() / kind / digest(made_from)
    with locked(folder / "lock"):
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
def locked(path: Path) -> Iterator[None]:
    """Hold a lock file, as another process may compute the same result."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
