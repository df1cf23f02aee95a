"""Notes on scenes, as lines of text: a command prints each once, whichever process reads the scene.

The main process prints notes; worker processes keep theirs and return them with their results.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from splatcore.sim.common.output import messages

_known: set[str] = set()
_kept: list[str] = []
_printing: list[int] = []  # ID of the process that prints, if any


@contextmanager
def printing() -> Iterator[None]:
    """Within this context, this process prints each note once."""
    _known.clear()
    _printing.append(os.getpid())
    try:
        yield
    finally:
        _printing.clear()


def hush():
    """Print no more notes: the command shows them in its own way."""
    _printing.clear()


def add(*lines: str):
    """Print new notes; in a worker, keep them."""
    for line in lines:
        if line in _known:
            continue
        _known.add(line)
        if _printing and _printing[-1] == os.getpid():
            messages.print(line, soft_wrap=True)
        else:
            _kept.append(line)


def with_notes(function: Callable, *arguments: object) -> tuple[object, list[str]]:
    """Call a function in a worker; return its result and the notes since the previous call."""
    try:
        return function(*arguments), list(_kept)
    finally:
        _kept.clear()
