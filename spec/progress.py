"""Progress of long work: code of any room reports it, and the application shows it.

A phase that takes seconds, as one over all Gaussians of a large scene, reports how much is done of
a known total, so that the time left can be estimated. Without an application nothing happens.
"""

import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

Advance = Callable[[float, float | None, str], object]
"""Called with what is done, the total (None: unknown) and the phase's label."""

_shown: list[Advance] = []  # innermost last


_interrupts: list[int] = []  # signals that have raised KeyboardInterrupt


def raise_again():
    """Let Ctrl-C end work even if its KeyboardInterrupt is lost: in a function that a library calls
    from C, as numba does when it loads compiled code, Python only prints it. The next report then
    raises it again."""
    _interrupts.clear()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def _interrupt(number: int, frame: object):
    _interrupts.append(number)
    raise KeyboardInterrupt


def check_interrupts():
    """Raise KeyboardInterrupt if there was an interrupt."""
    if _interrupts:
        raise KeyboardInterrupt


def report(label: str, done: float = 0, total: float | None = None):
    """Report that `done` of `total` of a phase are done."""
    check_interrupts()
    if _shown:
        _shown[-1](done, total, label)


def counted(
    label: str, items: Sequence[Item] | Iterable[Item], total: int | None = None
) -> Iterator[Item]:
    """Yield items, and report how many of them are done.

    total: number of items; default: their length
    """
    total = len(items) if total is None else total
    for done, item in enumerate(items):
        report(label, done, total)
        yield item
    report(label, total, total)


@contextmanager
def shown_by(advance: Advance) -> Iterator[None]:
    """Within this context, reports call `advance`."""
    _shown.append(advance)
    try:
        yield
    finally:
        _shown.remove(advance)
