"""Progress of long work: code of any room reports it, and the application shows it.

A phase that takes seconds, as one over all Gaussians of a large scene, reports how much is done of
a known total, so that the time left can be estimated. Without an application nothing happens.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")

Advance = Callable[[float, float | None, str], object]
"""Called with what is done, the total (None: unknown) and the phase's label."""

_shown: list[Advance] = []  # innermost last


def report(label: str, done: float = 0, total: float | None = None):
    """Report that `done` of `total` of a phase are done."""
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
