"""Writing results: whole files or none, and progress bars."""

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from splatcore.spec.error import InputError

console = Console(highlight=False)  # results, on standard output
messages = Console(stderr=True, highlight=False)  # progress, on standard error


def check_writable(*paths: Path | None):
    """InputError if a file could not be written there: asked before the work, not after it."""
    for path in paths:
        if path is None:
            continue
        folder = Path(path).absolute().parent
        if not folder.is_dir():
            raise InputError(f"{path}: there is no folder {folder}")
        if Path(path).is_dir():
            raise InputError(f"{path}: is a folder")
        if not os.access(folder, os.W_OK):
            raise InputError(f"{path}: the folder is not writable")


def check_folder(folder: Path | None):
    """InputError unless files can be written into a folder; it need not be there yet."""
    if folder is None:
        return
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is no folder")
    check_writable(folder / "file" if folder.is_dir() else folder)


def make_folder(folder: Path):
    """Make a folder to write into; InputError if that cannot be."""
    check_folder(folder)
    folder.mkdir(exist_ok=True)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A path to write to that becomes `path` at the end; a failure leaves what was there before."""
    path = Path(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".splatcore") as folder:
            part = Path(folder) / path.name
            yield part
            os.replace(part, path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def write(path: str | Path, data: bytes):
    """Write a file as a whole."""
    with whole_file(path) as part:
        part.write_bytes(data)


def write_json(path: Path | None, value: object):
    """Write an object (a dataclass or a dict) as JSON, if there is a path to write to."""
    if path is not None:
        value = value if isinstance(value, dict) else asdict(value)
        write(path, (json.dumps(value, indent=2, allow_nan=False) + "\n").encode())


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator:
    """A bar on standard error; yields advance(done, total) and removes the bar at the end."""
    text, count = TextColumn("{task.description}"), TextColumn("{task.completed}/{task.total}")
    columns = (text, BarColumn(), count, TimeElapsedColumn(), TimeRemainingColumn())
    terminal = messages.is_terminal
    with Progress(*columns, console=messages, transient=True, disable=not terminal) as progress:
        task = progress.add_task(label, total=total)

        def advance(done: int, total: int, label: str = label):
            progress.update(task, completed=done, total=total, description=label)

        yield advance
