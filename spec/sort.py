"""Stage 2: how lists are sorted. Sizes, records, scratch memory and the digits' schedule.

Batches of `Config.sub_sorter_entries` consecutive entries are sorted into runs. Up to
`Config.merge_ways` neighbouring runs are merged into one: always the smallest key first, of equal
keys the key of the earliest run. So up to `half_entries` are sorted at once, a *job*.

A longer list is *dealt* into `BUCKETS` buckets of neighbouring keys in scratch memory. These are
read as jobs: as many neighbouring buckets as fit into one, but no further bucket once the job has
half as many entries (`full_enough`). So a job's entries are read before the merge of the previous
job ends, which takes two cycles per entry. A round has these steps:

1. The whole list is read. An entry that has not been output yet goes to the bucket

       b = (key − base) >> shift, clamped to 0 … BUCKETS − 1.

   Each bucket keeps its first `half_entries`, in the order of the list, and counts all.
2. The buckets before the first one with more than `half_entries` are output.
3. If there is such a bucket b, the next round deals the rest: keys from its base on,

       low = base + (b << shift), or the smallest key of the round if that is greater or b = 0.

   Its buckets are 2^NARROWER times narrower, or twice as wide if b is the last bucket, but never
   wider than (greatest − low) >> shift < BUCKETS requires, up to the greatest key of the round. If
   all keys of bucket b are equal, that is, if low equals

       high = base + ((b + 1) << shift) − 1, or the greatest key if that is less or b is the last,

   the `half_entries` that were kept are a job, and the next round skips as many with this key.

The first round of a list takes base and shift from all keys of the previous long list: base is its
smallest key, shift reaches up to its greatest as above; neighbouring groups, and frames, have
nearly the same depths. The first long list after reset takes base 0 and `shift_max`. Rounds that
have output a job take the areas of scratch memory in turn, so that one list is dealt while another
is read.
"""

from typing import NamedTuple

from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, ENTRY_BITS, key_format
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Record

AREAS = 3
"""Areas of scratch memory: one is read, one waits to be read, one is written."""

BUCKET_BITS = 5
"""log2 of `BUCKETS`."""
BUCKETS = 1 << BUCKET_BITS
"""Buckets of an area: twice the number needed so that no bucket overflows, with base and shift from
the previous list (eleven views of trained scenes).
"""

NARROWER = 2
"""Bits that the shift loses if a bucket has too many entries.

With 2, one round reads the list for several such buckets; with 5, which is one bucket per round,
flowers at 320×178 is read 14 times instead of 4.
"""

LINE_SLOTS = 4
"""Entries per write to a bucket."""

CYCLE_DEPTH = 39
"""Maximum gates in series per cycle of digits, as estimated in `phases`."""


def index_bits(config: Config) -> int:
    """Return the width of an entry's index in its batch."""
    return config.sub_sorter_entries.bit_length() - 1


def way_bits(config: Config) -> int:
    """Return the width of a way's number."""
    return config.merge_ways.bit_length() - 1


def half_entries(config: Config) -> int:
    """Return the maximum entries per job: half of the sorter's memory."""
    return 1 << way_bits(config) + index_bits(config)


def full_enough(config: Config) -> int:
    """Return the entries with which a job of a long list takes no further bucket."""
    return half_entries(config) // 2


def shift_max(config: Config) -> int:
    """Return the largest shift, with which the buckets hold all possible keys."""
    return max(config.sort_key_bits - BUCKET_BITS, 0)


def bucket_shift(extent: int) -> int:
    """Return the smallest shift with which keys up to `extent` above the base have a bucket."""
    return max(extent.bit_length() - BUCKET_BITS, 0)


def job_record(config: Config) -> Record:
    """Entries to be sorted at once.

    count: number of entries
    last: the last job of a group
    """
    return Record("job", {"count": Bits(half_entries(config).bit_length()), "last": Bits(1)})


def listed_record() -> Record:
    """A list to be read.

    page: its first page; if dealt, area and bucket
    count: number of entries
    dealt: read a bucket in scratch memory
    """
    fields = {"page": Bits(PAGE_BITS), "count": Bits(COUNT_BITS), "dealt": Bits(1)}
    return Record("listed", fields)


def line_record(config: Config) -> Record:
    """Entries to be written to a bucket.

    address: area, bucket and place in the bucket, in lines
    slots: the entries
    """
    lines = (half_entries(config) // LINE_SLOTS - 1).bit_length()
    address = Bits((AREAS - 1).bit_length() + BUCKET_BITS + lines)
    return Record("line", {"address": address, "slots": Array(Bits(ENTRY_BITS), LINE_SLOTS)})


def batch_record(config: Config) -> Record:
    """An entry at the input of a sub-sorter; last: the last entry of its batch."""
    return Record("batch", {"key": key_format(config), "last": Bits(1)})


def ranked_record(config: Config) -> Record:
    """An entry of a run.

    index: its place in its batch
    last: the last entry of its run
    """
    index = Bits(index_bits(config))
    return Record("ranked", {"key": key_format(config), "index": index, "last": Bits(1)})


class Digit(NamedTuple):
    """A digit of a key."""

    low: int  # its lowest bit
    width: int


def digits(config: Config) -> list[Digit]:
    """Return the digits of a key, most significant first."""
    found, low = [], config.sort_key_bits
    for width in config.sort_digits:
        low -= width
        found.append(Digit(low, width))
    return found


def phases(config: Config) -> list[tuple[list[Digit], list[Digit]]]:
    """Return the digits of each phase of a sub-sorter, in its first and in its second cycle.

    A digit of w bits costs about log2(entries) + 3·w gates in series: a tree over the entries, a
    prefix over the lines and a choice. The second cycle also finds the remaining entries, one more
    tree, and in the last phase the lowest index, two trees.
    """
    trees = index_bits(config)
    cycles, room = [[]], CYCLE_DEPTH - 2 * trees
    for digit in reversed(digits(config)):
        cost = trees + 3 * digit.width
        if cost > room and cycles[-1]:
            cycles.append([])
            room = CYCLE_DEPTH - (trees if len(cycles) % 2 else 0)
        cycles[-1].insert(0, digit)
        room -= cost
    if len(cycles) % 2:
        cycles.append([])
    cycles.reverse()
    return [(cycles[k], cycles[k + 1]) for k in range(0, len(cycles), 2)]
