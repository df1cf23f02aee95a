"""Work on many items in batches: numpy's intermediate arrays stay in a core's cache, and threads
share the batches.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from numba import get_num_threads

from splatcore.spec.progress import counted

Result = TypeVar("Result")

BATCH = 1 << 14
"""Items per batch."""


def in_batches(work: Callable[[slice], Result], count: int) -> list[Result]:
    """Return the results of `work` on batches of items 0 … count − 1, in order.

    work: called with a slice of items; once with an empty slice if count is 0
    """
    size = -(-count // max(-(-count // BATCH), 1)) or 1  # numpy's bits depend on tiny batches
    batches = [slice(first, first + size) for first in range(0, max(count, 1), size)]
    with ThreadPoolExecutor(get_num_threads()) as pool:
        return list(counted("batches", pool.map(work, batches), len(batches)))
