"""Cases of stage 2 and its parts: entries with keys of several kinds."""

import numpy as np

from splatcore.golden.sort import sub_sort
from splatcore.spec.config import TINY, Config
from splatcore.spec.group import SPLAT_BITS
from splatcore.spec.record import Codes
from splatcore.spec.sort import batch_record, ranked_record
from tb.helpers.batches import KINDS
from tb.helpers.feeds import Feed

KEYS = {"full": "random", "tie": "equal", "saturated": "extreme"}
"""Kind of keys (`tb.helpers.batches`) by kind of case."""


def keys_of(config: Config, kind: str, counts: list[int]) -> list[np.ndarray]:
    """Keys of lists. counts: entries per list."""
    rng, keys = np.random.default_rng(0), KINDS[KEYS[kind]]
    return [keys(config.sort_key_bits, count, rng) for count in counts]


def entries_with(keys: list[np.ndarray]) -> Codes:
    """Entries of lists with these keys and random splats and masks."""
    joined = np.concatenate([np.zeros(0, np.uint64), *keys])
    rng, count = np.random.default_rng(1), len(joined)
    return {
        "key": joined,
        "splat": rng.integers(0, 1 << SPLAT_BITS, count, dtype=np.uint32),
        "mask": rng.integers(0, 1 << TINY.group**2, count, dtype=np.uint32),
    }


def batch_feed(config: Config, kind: str, **constants: int) -> Feed:
    """Batches of all sizes for a sub-sorter, including several full ones."""
    most = config.sub_sorter_entries
    batches = keys_of(config, kind, [most, most, most, *range(1, most), 1, 1, most])
    last = np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches])
    rows = batch_record(config).pack({"key": np.concatenate(batches), "last": last})
    return Feed({"i": rows}, {"o": ranked_record(config).pack(sub_sort(batches))}, constants)
