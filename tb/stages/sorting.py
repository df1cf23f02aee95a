"""Stage 2 and its sub-sorters: entries with keys of several kinds, sorted by the golden model."""

from collections.abc import Callable
from itertools import cycle

import numpy as np

from splatcore.golden.sort import Job, jobs, lines, sort, sub_sort
from splatcore.spec.binning import group_record
from splatcore.spec.config import TINY, Config
from splatcore.spec.group import SPLAT_BITS, entry_record, sorted_record
from splatcore.spec.record import Codes
from splatcore.spec.sort import (
    BUCKET_BITS,
    LINE_SLOTS,
    batch_record,
    half_entries,
    job_record,
    line_record,
    listed_record,
    ranked_record,
)
from splatcore.study.bench import sort_parts
from splatcore.study.bench.sort_parts import entries_of, random_keys, stage_rows
from tb.helpers.runs import Case


def close_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    return random_keys(bits - 1, 1, random) + random.integers(0, 3, count, dtype=np.uint64)


def extreme_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    return random.choice(np.array([0, (1 << bits) - 1], np.uint64), count)


KEYS = sort_parts.KEYS | {"close": close_keys, "extreme": extreme_keys}
"""Kinds of keys."""

KEYS_OF = {"full": "random", "tie": "equal", "saturated": "extreme"}
"""Kind of keys by kind of case."""


def sort_case(config: Config, counts, entries: Codes, last=1) -> Case:
    """Jobs of `counts` [J] entries. last: [J], 1 for the last job of a group."""
    counts = np.asarray(counts, int)
    last = np.broadcast_to(last, len(counts))
    jobs = job_record(config).pack({"count": counts, "last": last})
    inputs = {"jobs": jobs, "entries": entry_record(config).pack(entries)}
    expected = {"o": sorted_record(config).pack(sort(counts, last, entries))}
    return Case(inputs, expected, {"stop": 0, "clear": 0})


def spill_case(config: Config, counts, entries: Codes) -> Case:
    """Lists of `counts` entries, which may be dealt into buckets in scratch memory."""
    rows = stage_rows(config, np.array(counts), entries)
    return Case(rows.inputs, rows.expected, {"stop": 0})


def deal_case(config: Config, counts, entries: Codes) -> Case:
    """Lists of `counts` entries for dealing alone."""
    count = np.asarray(counts)
    start = np.concatenate([[0], np.cumsum(count)])
    lists = np.split(entries["key"], start[1:-1])
    page = np.arange(len(count)) * 3 + 1
    groups = group_record().pack({"page": page, "count": count})
    reading, read, written, given, listed = [], [], [], [], []
    for k, one in enumerate(jobs(config, lists)):
        if isinstance(one, Job):
            given.append((count[k], 1))
            listed.append((page[k], count[k], 0))
            continue
        for round_ in one:
            reading.append(k)
            read.append(np.arange(start[k], start[k + 1]))
            written += [(at, start[k] + some) for at, some in lines(config, round_)]
            for job in round_.jobs:
                given.append((len(job.order), job.last))
                listed += [(round_.area << BUCKET_BITS | b, n, 1) for b, n in job.buckets]
    read = np.concatenate([np.zeros(0, int), *read])
    packed = entry_record(config).pack(entries)
    slots = np.zeros((len(written), LINE_SLOTS), np.uint64)
    for row, (_, some) in zip(slots, written, strict=True):
        for slot, index in zip(range(LINE_SLOTS), some, strict=False):
            row[slot] = sum(int(byte) << 8 * k for k, byte in enumerate(packed[index]))
    given, listed = (np.array(rows, np.int64).reshape(len(rows), -1) for rows in (given, listed))
    listed = listed.reshape(-1, 3)
    expected = {
        "reading": groups[reading],
        "lines": line_record(config).pack(
            {"address": np.array([at for at, _ in written], np.uint32), "slots": slots}
        ),
        "jobs": job_record(config).pack({"count": given[:, 0], "last": given[:, 1]}),
        "lists": listed_record().pack(dict(zip(("page", "count", "dealt"), listed.T, strict=True))),
    }
    inputs = {"groups": groups, "entries": packed[read]}
    return Case(inputs, expected, {"settled": 1, "released": 1})


def batch_case(config: Config, batches: list[np.ndarray], **constants: int) -> Case:
    """Batches of keys for a sub-sorter."""
    last = np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches])
    rows = batch_record(config).pack({"key": np.concatenate(batches), "last": last})
    return Case({"i": rows}, {"o": ranked_record(config).pack(sub_sort(batches))}, constants)


def batches_of(config: Config, count: int, seed: int) -> list[np.ndarray]:
    """Batches of all kinds and sizes, first a full batch of each kind."""
    random = np.random.default_rng(seed)
    entries = config.sub_sorter_entries
    sizes = [entries] * len(KEYS) + [1, 2, 3, entries - 1]
    sizes += list(random.integers(1, entries + 1, count))
    return [
        keys(config.sort_key_bits, size, random)
        for keys, size in zip(cycle(KEYS.values()), sizes, strict=False)
    ]


def entries_for(config: Config, kind: str, counts, seed: int = 0) -> Codes:
    """Entries with keys of a kind; "tied": half of them share one key, which is not extreme."""
    entries = entries_of(config, "random" if kind == "tied" else kind, counts, seed)
    if kind == "tied":
        entries["key"][::2] = 1 << config.sort_key_bits - 2
    return entries


def keys_of(kind: str, counts: list[int]) -> list[np.ndarray]:
    """Keys of lists on TINY, by kind of case. counts: entries per list."""
    rng, keys = np.random.default_rng(0), KEYS[KEYS_OF[kind]]
    return [keys(TINY.sort_key_bits, count, rng) for count in counts]


def entries_with(keys: list[np.ndarray]) -> Codes:
    """Entries of lists with these keys and random splats and masks."""
    joined = np.concatenate([np.zeros(0, np.uint64), *keys])
    rng, count = np.random.default_rng(1), len(joined)
    return {
        "key": joined,
        "splat": rng.integers(0, 1 << SPLAT_BITS, count, dtype=np.uint32),
        "mask": rng.integers(0, 1 << TINY.group**2, count, dtype=np.uint32),
    }


MOST = half_entries(TINY)
COUNTS = [MOST, MOST, 0, MOST - 1, 1, 17, 0, 0, 16, 15, 33, MOST, 2]
"""Entries per job: the maximum of one merge, and around the size of a batch."""

LAST = [1, 0, 1, 0, 0, 1, 1, 0, 1, 1, 1, 0, 1]
"""Whether a job is the last of its group."""


def sort_kinds() -> dict[str, Case]:
    keys = {kind: keys_of(kind, COUNTS) for kind in KEYS_OF}
    found = {kind: sort_case(TINY, COUNTS, entries_with(k), LAST) for kind, k in keys.items()}
    return found | {"empty": sort_case(TINY, [0, 0, 0], entries_with([]))}


def spill_kinds(case: Callable = spill_case) -> dict[str, Case]:
    """Lists that do not fit on chip, for all of stage 2 or, by `deal_case`, for dealing alone.

    The bounds of a long list's buckets depend on the keys of the previous long list. Each case ends
    with a list of keys of all sizes, which leaves the state after a reset, so cases do not depend
    on each other.
    """
    all_sizes = np.linspace(0, (1 << TINY.sort_key_bits) - 1, MOST + 1).astype(np.uint64)
    counts, found = [3, MOST, MOST + 1, 1, 2 * MOST + 2, 20], {}
    for kind in KEYS_OF:
        keys = [*keys_of(kind, counts), all_sizes]
        found[kind] = case(TINY, list(map(len, keys)), entries_with(keys))
    return found


def batch_kinds(**constants: int) -> dict[str, Case]:
    """Batches of all sizes for a sub-sorter, including several full ones."""
    most = TINY.sub_sorter_entries
    sizes = [most, most, most, *range(1, most), 1, 1, most]
    return {kind: batch_case(TINY, keys_of(kind, sizes), **constants) for kind in KEYS_OF}
