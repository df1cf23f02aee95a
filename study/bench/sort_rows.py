"""Rows of stage 2's streams for tests and `sim.bench.sort`."""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.sort import Job, Round, jobs, sort
from splatcore.spec.binning import group_record
from splatcore.spec.config import Config
from splatcore.spec.group import SPLAT_BITS, entry_record, sorted_record
from splatcore.spec.record import Codes

Rows = dict[str, np.ndarray]


def random_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    return random.integers(0, 1 << bits, count, dtype=np.uint64)


def clustered_keys(bits: int, count: int, random: np.random.Generator) -> np.ndarray:
    """Keys with few values in the upper half of the bits and any value in the lower half."""
    low = bits // 2
    clusters = random_keys(bits - low, 1 + count // 16, random)
    return random.choice(clusters, count) << np.uint64(low) | random_keys(low, count, random)


KEYS = {
    "random": random_keys,
    "equal": lambda bits, count, random: np.full(count, random.integers(0, 1 << bits), np.uint64),
    "sorted": lambda *asked: np.sort(random_keys(*asked)),
    "reversed": lambda *asked: np.sort(random_keys(*asked))[::-1].copy(),
    "clustered": clustered_keys,
}
"""Kinds of keys: (bits, count, random generator) → keys [count] of `bits` bits."""


def entries_of(config: Config, kind: str, counts: np.ndarray, seed: int = 0) -> Codes:
    """Random entries for groups of `counts` [G] entries, with keys of a kind."""
    random, total = np.random.default_rng(seed), int(np.sum(counts))
    keys = [KEYS[kind](config.sort_key_bits, int(count), random) for count in counts]
    return {
        "key": np.concatenate([np.zeros(0, np.uint64), *keys]),
        "splat": random.integers(0, 1 << SPLAT_BITS, total, dtype=np.uint32),
        "mask": random.integers(0, 1 << config.group**2, total, dtype=np.uint32),
    }


@dataclass(frozen=True, eq=False)
class SortRows:
    """Rows for stage 2's input streams, and the expected rows of its output streams."""

    inputs: Rows
    expected: Rows

    @property
    def counts(self) -> dict[str, int]:
        return {name: len(rows) for name, rows in self.expected.items()}


def stage_rows(config: Config, counts: np.ndarray, entries: Codes) -> SortRows:
    """Rows of `SortStage` for lists of `counts` [G] entries, in order of arrival."""
    packed, ends = entry_record(config).pack(entries), np.cumsum(counts).astype(int)
    lists = np.split(np.arange(len(packed)), ends[:-1])
    found = list(jobs(config, [entries["key"][indices] for indices in lists]))
    short = [indices for indices, f in zip(lists, found, strict=True) if isinstance(f, Job)]
    long = [indices for indices, f in zip(lists, found, strict=True) for _ in rounds_of(f)]
    none = np.zeros(0, int)
    groups = group_record().pack({"page": np.arange(len(lists)), "count": np.asarray(counts)})
    return SortRows(
        {
            "groups": groups,
            "short": packed[np.concatenate([none, *short])],
            "long": packed[np.concatenate([none, *long])],
        },
        {"o": sorted_record(config).pack(sort(counts, np.ones(len(counts)), entries))},
    )


def rounds_of(found: Job | list[Round]) -> list[Round]:
    """The rounds of dealing of a list; none if it fits on chip."""
    return [] if isinstance(found, Job) else found
