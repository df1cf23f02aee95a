"""Work on batches of Gaussians that threads share."""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

from splatcore.spec import scene
from splatcore.spec.progress import report
from splatcore.spec.scene import batches

Result = TypeVar("Result")


def threads() -> int:
    """Return the number of processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
        return os.cpu_count() or 1


def in_threads(work: Callable[[slice], Result], count: int) -> Iterator[Result]:
    """Yield the results of `work` on the `batches` of `count` rows, in order.

    Each thread has at most two batches whose results have not been taken. numpy's settings of
    errors are the caller's. `spec.progress` gets the number of rows done.
    """
    if count <= scene.BATCH:
        yield from map(work, batches(count))
        return
    waiting, most = deque(), 2 * threads()
    with ThreadPoolExecutor(threads()) as pool:
        for rows in batches(count):
            waiting.append(pool.submit(copy_context().run, work, rows))
            if len(waiting) == most:
                yield waiting.popleft().result()
                report("Gaussians", rows.start, count)
        while waiting:
            yield waiting.popleft().result()
