"""Work on batches of rows that threads share."""

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

from splatcore.spec.progress import report
from splatcore.spec.scene import batches

Result = TypeVar("Result")


def threads() -> int:
    """Return the number of threads: as many as numba's, at most one for each processor that this
    process may use."""
    if number := os.environ.get("NUMBA_NUM_THREADS"):
        return int(number)
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        return os.cpu_count() or 1


def shared(work: Callable[[slice], Result], slices: Sequence[slice]) -> Iterator[Result]:
    """Yield the results of `work` on slices of rows, in order.

    Each thread has at most two slices whose results have not been taken. numpy's settings of
    errors are the caller's. `spec.progress` gets the number of slices done.
    """
    if len(slices) < 2 or threads() == 1:
        yield from map(work, slices)
        return
    waiting, most = deque(), 2 * threads()
    with ThreadPoolExecutor(threads()) as pool:
        for done, rows in enumerate(slices, 1 - most):
            waiting.append(pool.submit(copy_context().run, work, rows))
            if len(waiting) == most:
                yield waiting.popleft().result()
                report("batches", done, len(slices))
        while waiting:
            yield waiting.popleft().result()


def in_threads(work: Callable[[slice], Result], count: int) -> Iterator[Result]:
    """Yield the results of `work` on the `batches` of `count` rows, as `shared` does."""
    return shared(work, list(batches(count)))
