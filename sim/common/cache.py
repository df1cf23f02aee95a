"""The contents of the cache (`spec.cache`), and cached results in JSON files."""

import json
import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from splatcore.sim.common.output import write
from splatcore.spec.cache import cache_root, digest, locked

NAME = r"(library-)?[0-9a-f]{32}(\.json|\.lock)?"
"""Pattern of the names of cached files and folders."""

T = TypeVar("T")


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


def kept_json(kind: str, made_from: Any, compute: Callable[[], T]) -> T:
    """Return the result of `compute`, now or in an earlier run, as read back from JSON."""
    path = cache_root() / kind / f"{digest(made_from)}.json"
    with locked(path.with_suffix(".lock")):
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
