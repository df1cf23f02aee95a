"""Stage 2: how lists are sorted. Sizes, records, scratch memory and the digits' schedule.

Batches of `Config.sub_sorter_entries` consecutive entries are sorted into runs. Up to
`Config.merge_ways` neighbouring runs are merged into one, always the smallest key first, of equal
keys that of the earliest run. So up to `half_entries` are sorted at once, a *job*.

A longer list is *dealt* into `BUCKETS` buckets of neighbouring keys, which lie in scratch memory,
and these are read as jobs: neighbouring buckets, as many as fit into one but none to those with
half as many entries or more (`full_enough`), so that a job's entries have been read when the one
before has been merged, at two cycles an entry. A round goes like this:

1. The whole list is read. An entry that has not been given out goes to the bucket

       b = (key − base) >> shift, held within 0 … BUCKETS − 1.

   The first `half_entries` of each bucket are kept, in the order of the list; all are counted.
2. The buckets before the first one that has more than `half_entries` are given out.
3. If there is such a bucket b, the next round is about what follows from there on: keys from

       low = base + (b << shift), or the least key of the round if that is greater or b = 0

   on, which is its base. Its buckets are 2^NARROWER times narrower, or twice as wide where b is the
   last one, but none wider than for (greatest − low) >> shift < BUCKETS, up to the greatest key of
   the round. If all keys of bucket b are equal, as low is also

       high = base + ((b + 1) << shift) − 1, or the greatest key if that is less or b is the last

   the `half_entries` that are kept are a job, and the next round skips as many with this key.

The first round of a list takes base and shift from all keys of the long list before: base is the
least of them, shift as above up to the greatest; neighbouring groups, and frames, have much the
same depths. The first long list after reset takes base 0 and `shift_max`. Rounds that have given
out a job take the areas of scratch memory in turn, so that lists are dealt while others are read.
"""

from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, ENTRY_BITS, key_format
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Record

AREAS = 3
"""Areas of scratch memory: one is read, one waits to be, one is written."""

BUCKET_BITS = 5
BUCKETS = 1 << BUCKET_BITS
"""Buckets of an area: twice as many as it takes, by the least and greatest key of the list before,
that none has more entries than fit on chip (eleven views of trained scenes)."""

NARROWER = 2
"""Bits that the shift loses where a bucket has too many entries. So a round goes through the list
for several of such buckets; with 5, which is one at a time, flowers at 320×178 is read 14 times
instead of 4."""

LINE_SLOTS = 4
"""Entries that are written to a bucket together."""

CYCLE_DEPTH = 39
"""Most gates of a cycle's digits and what follows them, by the estimate of `phases`."""


def index_bits(config: Config) -> int:
    """Width of an entry's index in its batch."""
    return config.sub_sorter_entries.bit_length() - 1


def way_bits(config: Config) -> int:
    """Width of a way's number."""
    return config.merge_ways.bit_length() - 1


def half_entries(config: Config) -> int:
    """Entries that are sorted by one merge: a half of the on-chip memory."""
    return 1 << way_bits(config) + index_bits(config)


def full_enough(config: Config) -> int:
    """Entries with which a job of a long list takes no further bucket."""
    return half_entries(config) // 2


def shift_max(config: Config) -> int:
    """The largest shift: buckets of all keys that there are."""
    return max(config.sort_key_bits - BUCKET_BITS, 0)


def bucket_shift(extent: int) -> int:
    """The smallest shift with which keys up to `extent` above the base have a bucket each."""
    return max(extent.bit_length() - BUCKET_BITS, 0)


def job_record(config: Config) -> Record:
    """Entries to be sorted at once. last: of their group."""
    return Record("job", {"count": Bits(half_entries(config).bit_length()), "last": Bits(1)})


def listed_record() -> Record:
    """A list to be read: its first page, or (dealt 1) area and bucket, and how many entries."""
    fields = {"page": Bits(PAGE_BITS), "count": Bits(COUNT_BITS), "dealt": Bits(1)}
    return Record("listed", fields)


def line_record(config: Config) -> Record:
    """Entries to be written to a bucket; address: area, bucket and place there, in lines."""
    lines = (half_entries(config) // LINE_SLOTS - 1).bit_length()
    address = Bits((AREAS - 1).bit_length() + BUCKET_BITS + lines)
    return Record("line", {"address": address, "slots": Array(Bits(ENTRY_BITS), LINE_SLOTS)})


def batch_record(config: Config) -> Record:
    """An entry of a batch on its way into a sub-sorter. last: of its batch."""
    return Record("batch", {"key": key_format(config), "last": Bits(1)})


def ranked_record(config: Config) -> Record:
    """An entry of a run. index: where it was in its batch; last: of its run."""
    index = Bits(index_bits(config))
    return Record("ranked", {"key": key_format(config), "index": index, "last": Bits(1)})


Digit = tuple[int, int]
"""A digit's lowest bit and its width."""


def digits(config: Config) -> list[Digit]:
    """The digits of a key, most significant first."""
    found, low = [], config.sort_key_bits
    for width in config.sort_digits:
        low -= width
        found.append((low, width))
    return found


def phases(config: Config) -> list[tuple[list[Digit], list[Digit]]]:
    """The digits that each phase of a sub-sorter looks at in its first and in its second cycle.

    A digit of w bits costs about log2(entries) + 3·w gates one after the other: a tree over the
    entries, a prefix over the lines and a choice. The second cycle also asks what is left, a tree
    more, and that of the last phase finds the lowest index, two trees.
    """
    trees = index_bits(config)
    cycles, room = [[]], CYCLE_DEPTH - 2 * trees
    for low, width in reversed(digits(config)):
        cost = trees + 3 * width
        if cost > room and cycles[-1]:
            cycles.append([])
            room = CYCLE_DEPTH - (trees if len(cycles) % 2 else 0)
        cycles[-1].insert(0, (low, width))
        room -= cost
    if len(cycles) % 2:
        cycles.append([])
    cycles.reverse()
    return [(cycles[k], cycles[k + 1]) for k in range(0, len(cycles), 2)]
