"""A sub-sorter of OR-trees: batches in, sorted batches out.

No empty: a batch has at least one entry.
"""

from functools import partial

from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.sort_cases import KEYS, batch_feed

component = partial(SubSorter, TINY)


def cases() -> dict[str, Feed]:
    return {kind: batch_feed(TINY, kind, drop=0) for kind in KEYS}
