"""Work on many items in batches: what numpy makes of one stays in a core's cache, and threads share
them."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from numba import get_num_threads

Result = TypeVar("Result")

BATCH = 1 << 14  # items


def in_batches(work: Callable[[slice], Result], count: int) -> list[Result]:
    """The results of work on items 0 … count, batch after batch; of none at least one batch."""
    batches = [slice(first, first + BATCH) for first in range(0, max(count, 1), BATCH)]
    with ThreadPoolExecutor(get_num_threads()) as pool:
        return list(pool.map(work, batches))
