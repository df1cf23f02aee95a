"""Golden model of a sub-sorter: a stable sort."""

from collections.abc import Sequence

import numpy as np

from splatcore.spec.record import Codes


def sub_sort(batches: Sequence[np.ndarray]) -> Codes:
    """Codes of `ranked_record`, batch after batch, for keys [n] of each batch in arrival order."""
    orders = [np.argsort(keys, kind="stable") for keys in batches]
    return {
        "key": np.concatenate([keys[order] for keys, order in zip(batches, orders, strict=True)]),
        "index": np.concatenate(orders).astype(np.uint16),
        "last": np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches]),
    }
