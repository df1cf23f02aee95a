"""Work on many items in batches: numpy's intermediate arrays stay in a core's cache, and threads
share the batches.
"""

from collections.abc import Callable
from typing import TypeVar

from splatcore.spec.threads import shared

Result = TypeVar("Result")

BATCH = 1 << 14
"""Most items per batch."""


def in_batches(work: Callable[[slice], Result], count: int) -> list[Result]:
    """Return the results of `work` on batches of items 0 … count − 1, in order.

    work: called with a slice of items; once with an empty slice if count is 0
    """
    size = -(-count // max(-(-count // BATCH), 1)) or 1  # numpy's bits depend on tiny batches
    return list(shared(work, [slice(k, k + size) for k in range(0, max(count, 1), size)]))
