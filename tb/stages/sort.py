"""Sort: jobs and their entries in, sorted entries and a mark after each group out."""

from functools import partial

import numpy as np

from splatcore.hdl.sorting.sort import Sort
from splatcore.spec.config import TINY
from splatcore.spec.sort import half_entries
from splatcore.study.bench.sort_rows import sort_rows
from tb.helpers.feeds import Feed
from tb.helpers.sort_cases import KEYS, entries_with, keys_of

MOST = half_entries(TINY)
COUNTS = [MOST, MOST, 0, MOST - 1, 1, 17, 0, 0, 16, 15, 33, MOST, 2]
"""Entries per job: the maximum of one merge, and around the size of a batch."""

LAST = [1, 0, 1, 0, 0, 1, 1, 0, 1, 1, 1, 0, 1]
"""Whether a job is the last of its group."""

component = partial(Sort, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed(keys_of(TINY, kind, COUNTS), LAST) for kind in KEYS} | {
        "empty": feed(keys_of(TINY, "full", [0, 0, 0]), [1, 1, 1])
    }


def feed(keys: list[np.ndarray], last: list[int]) -> Feed:
    rows = sort_rows(TINY, np.array(list(map(len, keys))), entries_with(keys), last)
    return Feed(rows.inputs, rows.expected, {"stop": 0, "clear": 0})
