"""A sub-sorter that is a cascade of merges: batches in, sorted batches out.

No empty: a batch has at least one entry.
"""

from functools import partial

from splatcore.hdl.sorting.cascade import Cascade
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.sort_cases import KEYS, batch_feed

component = partial(Cascade, TINY)


def cases() -> dict[str, Feed]:
    return {kind: batch_feed(TINY, kind) for kind in KEYS}
