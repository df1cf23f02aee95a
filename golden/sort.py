"""Golden model of stage 2, sorting: the contents of each of its streams, by `spec.sort`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.spec.config import Config
from splatcore.spec.record import Codes
from splatcore.spec.sort import address, half_entries, read_entries

FIELDS = ("key", "splat", "mask")


@dataclass(frozen=True, eq=False)
class Sorted:
    """Codes of what each stream carries: `sorted_record`, `spill_record`, `wanted_record`, and
    `entry_record` of what is read back.
    """

    o: Codes
    spill: Codes
    wanted: Codes
    back: Codes


def sort(config: Config, counts: np.ndarray, entries: Codes) -> Sorted:
    """Groups of `counts` [G] entries each, whose codes [N] follow each other in `entries`."""
    ends = np.cumsum(counts)
    assert (ends[-1] if len(ends) else 0) == len(entries["key"])
    groups = [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
    order = np.concatenate(
        [np.argsort(entries["key"][group], kind="stable") + group.start for group in groups]
        or [np.zeros(0, int)]
    )
    marks = ends.astype(int)  # a mark is inserted before what follows the group
    given = {field: np.insert(entries[field][order], marks, 0) for field in ("splat", "mask")}
    given["end"] = np.insert(np.zeros(len(order), np.uint8), marks, 1)
    runs, pieces = [], []
    for group in groups:
        for merge in _merges(config, entries["key"][group], group.start):
            runs += merge.written
            pieces += _pieces(config, merge)
    spilled = np.concatenate([np.zeros(0, int), *(run.order for run in runs)])
    addresses = [address(run.area, run.start) + np.arange(len(run.order)) for run in runs]
    back = np.concatenate([np.zeros(0, int), *(piece.order for piece in pieces)])
    spill = {"address": np.concatenate([np.zeros(0, np.uint32), *addresses]).astype(np.uint32)}
    spill["entry"] = {field: entries[field][spilled] for field in FIELDS}
    wanted = {"address": np.array([address(p.area, p.start) for p in pieces], np.uint32)}
    wanted["count"] = np.array([len(p.order) for p in pieces], np.uint32)
    return Sorted(given, spill, wanted, {field: entries[field][back] for field in FIELDS})


@dataclass(frozen=True, eq=False)
class Run:
    """Entries that lie in order in scratch memory from a position of an area on."""

    area: int
    start: int
    order: np.ndarray  # indices of entries


@dataclass(frozen=True, eq=False)
class Merged:
    """A merge of scratch memory's runs `read`; order: of all their entries, as indices into those
    of the runs one after the other. written: the runs that were spilled on the way to this merge.
    """

    written: list[Run]
    read: list[Run]
    order: np.ndarray


def _merges(config: Config, keys: np.ndarray, first: int) -> Iterator[Merged]:
    """The merges from scratch memory for a list of keys [n], whose entries begin at `first`."""
    step, ways = half_entries(config), config.merge_ways
    if len(keys) <= step:
        return
    runs = []
    for start in range(0, len(keys), step):
        order = start + np.argsort(keys[start : start + step], kind="stable")
        runs.append(Run(0, start, first + order))
    written = runs
    while runs:
        done = len(runs) <= ways
        merged = []
        for k in range(0, len(runs), ways):
            read = runs[k : k + ways]
            joined = np.concatenate([run.order for run in read])
            order = np.argsort(keys[joined - first], kind="stable")
            yield Merged(written, read, order)
            written = [] if done else [Run(1 - read[0].area, read[0].start, joined[order])]
            merged += written
        runs = merged


def _pieces(config: Config, merge: Merged) -> list[Run]:
    """The pieces of runs that a merge reads, in the order of its requests."""
    size, room = read_entries(config), config.sub_sorter_entries // read_entries(config)
    pieces = [
        [
            Run(run.area, run.start + k, run.order[k : k + size])
            for k in range(0, len(run.order), size)
        ]
        for run in merge.read
    ]
    asked = [run[k] for k in range(room) for run in pieces if k < len(run)]
    lengths = [len(run.order) for run in merge.read]
    way = np.repeat(np.arange(len(lengths)), lengths)[merge.order]
    position = np.concatenate([np.arange(length) for length in lengths])[merge.order]
    for k in np.flatnonzero(position % size == size - 1):
        following = position[k] // size + room
        if following < len(pieces[way[k]]):
            asked.append(pieces[way[k]][following])
    return asked


def sub_sort(batches: Sequence[np.ndarray]) -> Codes:
    """A sub-sorter's codes of `ranked_record` for the keys [n] of each batch in arrival order."""
    orders = [np.argsort(keys, kind="stable") for keys in batches]
    return {
        "key": np.concatenate([keys[order] for keys, order in zip(batches, orders, strict=True)]),
        "index": np.concatenate(orders).astype(np.uint16),
        "last": np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches]),
    }
