"""Writing results: checks of paths, files written as a whole or not at all, progress bars."""

import json
import os
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from splatcore.sim.common.version import version
from splatcore.spec.error import InputError
from splatcore.spec.progress import check_interrupts, shown_by

console = Console(highlight=False, markup=False, soft_wrap=True)  # results, on standard output
messages = Console(stderr=True, highlight=False, markup=False)  # progress, on standard error

EVERY = 10.0  # seconds between lines of progress if there is no terminal


def check_writable(path: Path):
    """Raise InputError if a file cannot be written here. Called before long work, not after it."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{path}: folder {folder} does not exist")
    if path.is_dir():
        raise InputError(f"{path}: is a folder")
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a file")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path}: folder {folder} is not writable")


def check_folder(folder: Path):
    """Raise InputError unless files can be written into a folder, which need not exist yet."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is not a folder")
    check_writable(folder / "file" if folder.is_dir() else folder)


def check_distinct(written: list[tuple[str, Path]], read: Iterable[Path] = ()):
    """Raise InputError if two outputs are one file, or an output is an input.

    written: outputs, each with the name of its option
    read: inputs

    Paths and links to the same file are the same.
    """
    inputs = list(read)
    for number, (option, path) in enumerate(written):
        for other, taken in written[:number]:
            if _same(path, taken):
                raise InputError(f"{path}: {other} and {option} name the same file")
        for source in inputs:
            if found := _overwritten(path, source):
                raise InputError(f"{path}: {option} would overwrite {found}, an input")


INPUTS = (
    ("images", "sparse", "colmap", "point_cloud"),
    (".bin", ".txt", "cameras.json", "transforms.json", "transforms_train.json"),
)
"""Inputs in a folder: everything in subfolders of these names, and files with these endings."""


def _overwritten(path: Path, source: Path) -> Path | None:
    """Return the input that writing `path` would overwrite, a file or one in a folder; or None."""
    if not source.is_dir():
        return source if _same(path, source) else None
    inside = Path(os.path.realpath(path))
    if not (path.is_file() and inside.is_relative_to(os.path.realpath(source))):
        return None
    folders, ends = INPUTS
    first = inside.relative_to(os.path.realpath(source)).parts[0]
    return path if first in folders or path.name.endswith(ends) else None


def _same(one: Path, other: Path) -> bool:
    """Return whether two paths name the same file, which need not exist."""
    with suppress(OSError):
        return os.path.samefile(one, other)
    return os.path.realpath(one) == os.path.realpath(other)


def make_folder(folder: Path):
    """Make a folder to write into; raise InputError if that is not possible."""
    check_folder(folder)
    folder.mkdir(exist_ok=True)


@contextmanager
def new_folders(folders: Iterable[Path]) -> Iterator[None]:
    """Within this context, a failure removes new folders that are empty."""
    new = [folder for folder in folders if not folder.exists()]
    try:
        yield
    except BaseException:
        for place in new:
            for folder, _, _ in os.walk(place, topdown=False):
                with suppress(OSError):  # not empty
                    os.rmdir(folder)
        raise


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` at the end; a failure leaves `path` unchanged."""
    path = Path(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".splatcore") as folder:
            part = Path(folder) / path.name
            yield part
            os.replace(part, path)
    except InputError as error:
        raise InputError(str(error).replace(str(part), str(path))) from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None


def write(path: str | Path, data: bytes):
    """Write a file as a whole or not at all."""
    with whole_file(path) as part:
        part.write_bytes(data)


def write_json(path: Path | None, value: object):
    """Write a dataclass or dict as JSON, with the key `version`; do nothing if `path` is None."""
    if path is not None:
        value = dict(value) if isinstance(value, dict) else asdict(value)
        value.setdefault("version", version())
        write(path, (json.dumps(value, indent=2, allow_nan=False) + "\n").encode())


class Count(ProgressColumn):
    """A column with done/total, empty if the total is unknown."""

    def render(self, task: Task) -> Text:
        return Text("" if task.total is None else f"{task.completed:g}/{task.total:g}")


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator:
    """Show a bar on standard error; yield advance(done, total, label) and remove the bar at the
    end. Phases that `spec.progress` reports meanwhile are shown after the label.

    If standard error is not a terminal, print a line every `EVERY` seconds instead.
    """
    with (_bar if messages.is_terminal else _progress_lines)(label, total) as show:
        current = label

        def advance(done: int, total: int | None, label: str = label):
            nonlocal current
            check_interrupts()
            current = label
            show(done, total, label)

        check_interrupts()
        with shown_by(lambda done, total, phase: show(done, total, f"{current}: {phase}")):
            yield advance


@contextmanager
def _bar(label: str, total: int | None) -> Iterator:
    """Show a bar on the terminal."""
    text = TextColumn("{task.description}")
    columns = (text, BarColumn(), Count(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task(label, total=total)

        def show(done: int, total: int | None, label: str):
            progress.update(task, completed=done, total=total, description=label)

        yield show


class Phase:
    """A phase of work: another begins with another total, or if less is done than before."""

    def __init__(self, label: str, total: int | None):
        self.begin = time.monotonic()
        self.state, self.start = (0, total, label), (self.begin, 0)

    def advance(self, done: int, total: int | None, label: str):
        """Take over a new state."""
        if total != self.state[1] or done < self.state[0]:
            self.start = time.monotonic(), done
        self.state = done, total, label

    @property
    def line(self) -> str:
        """Label, done/total, seconds since the beginning and, if the phase has a total, an estimate
        of the seconds left to it."""
        (done, total, label), (start, first), now = self.state, self.start, time.monotonic()
        line = f"{label}{'' if total is None else f' {done:g}/{total:g}'}, {now - self.begin:.0f} s"
        if total is None or not first < done < total:
            return line
        return f"{line}, {(now - start) * (total - done) / (done - first):.0f} s left"


@contextmanager
def _progress_lines(label: str, total: int | None) -> Iterator:
    """Print lines instead of a bar, even if nothing advances."""
    ended, phase = threading.Event(), Phase(label, total)

    def print_lines():
        while not ended.wait(EVERY):
            messages.print(phase.line, soft_wrap=True)

    thread = threading.Thread(target=print_lines, daemon=True)
    thread.start()
    try:
        yield phase.advance
    finally:
        ended.set()
        thread.join()
