"""Sort with lists that do not fit on chip: dealing into buckets in scratch memory, then sorting.

No empty: groups without entries have no list.

The bounds of a long list's buckets depend on the keys of the previous long list. Each case ends
with a list of keys of all sizes, which leaves the state after a reset, so cases do not depend on
each other.
"""

from functools import partial

import numpy as np

from splatcore.spec.config import TINY
from splatcore.spec.sort import half_entries
from splatcore.study.bench.sort_rows import stage_rows
from splatcore.study.bench.sort_stage import SortStage
from tb.helpers.feeds import Feed
from tb.helpers.sort_cases import KEYS, entries_with, keys_of

FITS = half_entries(TINY)
COUNTS = [3, FITS, FITS + 1, 1, 2 * FITS + 2, 20]

component = partial(SortStage, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed([*keys_of(TINY, kind, COUNTS), all_sizes()]) for kind in KEYS}


def all_sizes() -> np.ndarray:
    return np.linspace(0, (1 << TINY.sort_key_bits) - 1, FITS + 1).astype(np.uint64)


def feed(keys: list[np.ndarray]) -> Feed:
    rows = stage_rows(TINY, np.array(list(map(len, keys))), entries_with(keys))
    return Feed(rows.inputs, rows.expected, {"stop": 0})
