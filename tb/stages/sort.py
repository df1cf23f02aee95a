"""Sort: jobs and their entries in, the entries in order and marks behind groups out."""

from functools import partial

import numpy as np

from splatcore.hdl.sorting.sort import Sort
from splatcore.sim.bench.sort_rows import sort_rows
from splatcore.spec.config import TINY
from splatcore.spec.sort import half_entries
from tb.helpers.feeds import Feed
from tb.helpers.sort_cases import KEYS, entries_with, keys_of

MOST = half_entries(TINY)
COUNTS = [MOST, MOST, 0, MOST - 1, 1, 17, 0, 0, 16, 15, 33, MOST, 2]
"""Entries of the jobs: as many as can be merged at once, and around a batch."""

LAST = [1, 0, 1, 0, 0, 1, 1, 0, 1, 1, 1, 0, 1]
"""Jobs with which a group ends."""

component = partial(Sort, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed(keys_of(TINY, kind, COUNTS), LAST) for kind in KEYS} | {
        "empty": feed(keys_of(TINY, "full", [0, 0, 0]), [1, 1, 1])
    }


def feed(keys: list[np.ndarray], last: list[int]) -> Feed:
    rows = sort_rows(TINY, np.array(list(map(len, keys))), entries_with(keys), last)
    return Feed(rows.inputs, rows.expected, {"stop": 0, "clear": 0})
