"""Stage 2's front against its golden model: rounds, buckets, jobs."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.sort import Job, jobs, lines
from splatcore.hdl.sorting.deal import Deal
from splatcore.sim.bench.sort_rows import KEYS, entries_of
from splatcore.spec.binning import group_record
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.group import entry_record
from splatcore.spec.sort import (
    BUCKET_BITS,
    LINE_SLOTS,
    half_entries,
    job_record,
    line_record,
    listed_record,
)
from tb.helpers.runs import check_run, compiled

MACHINES = {
    "TINY": TINY,
    "DEFAULT": DEFAULT,
    "NARROW": replace(TINY, sort_digits=(1,) * 8),
}


def deal_rows(config, lists: list[np.ndarray], entries) -> tuple[dict, dict]:
    """Rows of the streams in, and of those that must come out, for lists with these keys; `entries`
    are those of all lists."""
    count = np.array([len(keys) for keys in lists])
    start = np.concatenate([[0], np.cumsum(count)])
    page = np.arange(len(count)) * 3 + 1
    groups = group_record().pack({"page": page, "count": count})
    reading, read, written, given, listed = [], [], [], [], []
    for k, found in enumerate(jobs(config, lists)):
        if isinstance(found, Job):
            given.append((count[k], 1))
            listed.append((page[k], count[k], 0))
            continue
        for round_ in found:
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
    return {"groups": groups, "entries": packed[read]}, {
        "reading": groups[reading],
        "lines": line_record(config).pack(
            {"address": np.array([at for at, _ in written], np.uint32), "slots": slots}
        ),
        "jobs": job_record(config).pack({"count": given[:, 0], "last": given[:, 1]}),
        "lists": listed_record().pack(dict(zip(("page", "count", "dealt"), listed.T, strict=True))),
    }


def check(name: str, kind: str, counts, stall: float = 0, seed: int = 0):
    config = MACHINES[name]
    entries = entries_of(config, kind, counts, seed)
    ends = np.cumsum(counts)
    lists = np.split(entries["key"], ends[:-1])
    inputs, expected = deal_rows(config, lists, entries)
    return check_run(
        compiled(Deal, config), inputs, expected, f"{kind} {counts}: ",
        constants={"start": 0, "settled": 1, "released": 1}, stall=stall, seed=seed, idle_max=3000,
    )  # fmt: skip


@pytest.mark.parametrize("kind", KEYS)
@pytest.mark.parametrize("stall", [0, 0.4])
def test_tiny_equals_golden(kind, stall):
    half = half_entries(TINY)
    check("TINY", kind, [3, half, half + 1, 1, 300, 5, 1000, 70, 2 * half, 4], stall)
