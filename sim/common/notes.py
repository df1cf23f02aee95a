"""Notes on scenes for people: each is printed once by a command, whichever process reads the scene.

The process of a command prints; its workers keep their notes, and hand them over with results.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from splatcore.sim.common.output import messages

_told: set[str] = set()
_kept: list[str] = []
_printing: list[int] = []  # the process that prints, if there is one


@contextmanager
def printed() -> Iterator[None]:
    """This process prints notes meanwhile, each once."""
    _told.clear()
    _printing.append(os.getpid())
    try:
        yield
    finally:
        _printing.clear()


def hush():
    """The command says notes in its own way."""
    _printing.clear()


def tell(*lines: str):
    """Print lines that have not been said before; in a worker keep them."""
    for line in lines:
        if line in _told:
            continue
        _told.add(line)
        if _printing and _printing[-1] == os.getpid():
            messages.print(line, markup=False, soft_wrap=True)
        else:
            _kept.append(line)


def with_notes(function: Callable, *arguments: object) -> tuple[object, list[str]]:
    """In a worker: a call's result, and the notes since the call before."""
    try:
        return function(*arguments), list(_kept)
    finally:
        _kept.clear()
