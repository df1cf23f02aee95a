"""Stage 2: how lists are sorted. Sizes, records, scratch memory and the digits' schedule.

Batches of `Config.sub_sorter_entries` consecutive entries are sorted into runs. Up to
`Config.merge_ways` neighbouring runs are merged into one, always the smallest key first, of equal
keys that of the earliest run. A list of up to `half_entries` is sorted by one such merge, a *job*.

A longer list is cut into jobs of `half_entries` (the last may be shorter). Each is merged into a
run in area 0 of scratch memory, at the positions that its entries had in the list. Levels follow:
as long as there are more than `merge_ways` runs, each `merge_ways` neighbours are merged into one
in the other area, at the same positions; then the rest is merged and given out.

A merge from scratch memory reads `read_entries` at a time, aligned, fewer only at the list's end.
First every way in turn asks for its first piece, then every way for its second, up to the
`half_entries` / `merge_ways` entries that it has room for; ways without any left are passed over.
Then, whenever the merge has taken the last entry of a piece from a way, the way asks for the next
piece that it has not asked for, if there is one.
"""

from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, entry_record, key_format
from splatcore.spec.number import Bits
from splatcore.spec.record import Record

READ_ENTRIES_MAX = 16
"""Most entries that are read back from scratch memory at a time."""

AREAS = 2
"""Areas of scratch memory: one is read while the other is written."""

ADDRESS_BITS = COUNT_BITS + 1
"""Width of an address in scratch memory, in entries: the area above the position in the list."""

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


def read_entries(config: Config) -> int:
    """Entries that are read back at a time: a way has room for two such pieces at least."""
    return min(READ_ENTRIES_MAX, config.sub_sorter_entries // 2)


def address(area: int, position: int) -> int:
    """Address of an entry in scratch memory."""
    return area << COUNT_BITS | position


def count_record() -> Record:
    """A group of entries to be sorted."""
    return Record("count", {"count": Bits(COUNT_BITS)})


def batch_record(config: Config) -> Record:
    """An entry of a batch on its way into a sub-sorter. last: of its batch."""
    return Record("batch", {"key": key_format(config), "last": Bits(1)})


def ranked_record(config: Config) -> Record:
    """An entry of a run. index: where it was in its batch; last: of its run."""
    index = Bits(index_bits(config))
    return Record("ranked", {"key": key_format(config), "index": index, "last": Bits(1)})


def spill_record(config: Config) -> Record:
    """An entry to be written to scratch memory."""
    return Record("spill", {"address": Bits(ADDRESS_BITS), "entry": entry_record(config)})


def wanted_record(config: Config) -> Record:
    """Entries to be read back, from an address on."""
    width = read_entries(config).bit_length()
    return Record("wanted", {"address": Bits(ADDRESS_BITS), "count": Bits(width)})


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
