"""Golden model of stage 2, sorting: the contents of each of its streams, as in `spec.sort`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from splatcore.spec import sort as stage_2
from splatcore.spec.config import Config
from splatcore.spec.record import Codes


@dataclass(frozen=True, eq=False)
class Job:
    """Entries that are sorted at once."""

    order: np.ndarray  # [n] indices into their list
    last: bool  # the last job of the list
    # For a long list, the buckets they come from, each with its number of entries.
    buckets: list[tuple[int, int]] | None = None


@dataclass(frozen=True, eq=False)
class Round:
    """A round of dealing."""

    area: int  # area of scratch memory
    kept: list[np.ndarray]  # indices that each bucket keeps, in the list's order
    jobs: list[Job] = field(default_factory=list)  # jobs that the round outputs


@dataclass
class Dealer:
    """Deals long lists, one after the other."""

    config: Config

    def __post_init__(self):
        # They map the next list's keys to buckets in its first round.
        self.base, self.shift = 0, stage_2.shift_max(self.config)
        self.area = 0  # of the next round

    def learn(self, keys: np.ndarray):
        """Set base and shift for a list with keys like these."""
        self.base = int(keys.min())
        self.shift = stage_2.bucket_shift(int(keys.max()) - self.base)

    def rounds(self, keys: np.ndarray) -> Iterator[Round]:
        """Yield the rounds of a list with keys [n] in arrival order."""
        half, keys = stage_2.half_entries(self.config), keys.astype(np.int64)
        base, shift, left = self.base, self.shift, np.arange(len(keys))
        self.learn(keys)
        while len(left):
            least, greatest = int(keys[left].min()), int(keys[left].max())
            bucket = np.clip(keys[left] - base >> shift, 0, stage_2.BUCKETS - 1)
            members = [left[bucket == b] for b in range(stage_2.BUCKETS)]
            found = Round(self.area, [indices[:half] for indices in members])
            full = (b for b, indices in enumerate(members) if len(indices) > half)
            over = next(full, stage_2.BUCKETS)
            for some in joined(self.config, [len(indices) for indices in members[:over]]):
                order = np.concatenate([members[b] for b, _ in some])
                found.jobs.append(Job(order, False, some))
                left = np.setdiff1d(left, order, assume_unique=True)
            if over < stage_2.BUCKETS:
                low = max(base + (over << shift), least) if over else least
                last = over == stage_2.BUCKETS - 1
                high = greatest if last else min(base + (over + 1 << shift) - 1, greatest)
                wanted = shift + 1 if last else max(shift - stage_2.NARROWER, 0)
                base, shift = low, min(wanted, stage_2.bucket_shift(greatest - low))
                if low == high:
                    found.jobs.append(Job(members[over][:half], False, [(over, half)]))
                    left = np.setdiff1d(left, members[over][:half], assume_unique=True)
            if found.jobs:
                self.area = (self.area + 1) % stage_2.AREAS
                if not len(left):
                    found.jobs[-1] = Job(found.jobs[-1].order, True, found.jobs[-1].buckets)
            yield found


def joined(config: Config, counts: Sequence[int]) -> Iterator[list[tuple[int, int]]]:
    """Yield the jobs of neighbouring buckets: numbers and counts of buckets with entries."""
    some: list[tuple[int, int]] = []
    half, enough = stage_2.half_entries(config), stage_2.full_enough(config)
    for bucket, count in enumerate(counts):
        total = sum(n for _, n in some)
        if count and (total >= enough or total + count > half):
            yield some
            some = []
        if count:
            some.append((bucket, count))
    if some:
        yield some


def jobs(
    config: Config, lists: Sequence[np.ndarray], again: bool = False
) -> Iterator[list[Round] | Job]:
    """Yield how each list is sorted: in one job, or in rounds of buckets.

    lists: keys [n] of each list, in arrival order
    again: the same lists were sorted in the previous frame, and nothing else since reset
    """
    dealer, half = Dealer(config), stage_2.half_entries(config)
    long = [keys for keys in lists if len(keys) > half]
    if again and long:
        dealer.learn(long[-1])
    for keys in lists:
        if len(keys) > half:
            yield list(dealer.rounds(keys))
        else:
            yield Job(np.arange(len(keys)), True)


def lines(config: Config, found: Round) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the lines that a round writes: address, and indices of the entries.

    Full lines come first, as they fill up, then the others bucket by bucket.
    """
    size, full, rest = stage_2.half_entries(config) // stage_2.LINE_SLOTS, [], []
    for bucket, kept in enumerate(found.kept):
        at = (found.area << stage_2.BUCKET_BITS | bucket) * size
        for number, first in enumerate(range(0, len(kept), stage_2.LINE_SLOTS)):
            line = kept[first : first + stage_2.LINE_SLOTS]
            (full if len(line) == stage_2.LINE_SLOTS else rest).append((at + number, line))
    yield from sorted(full, key=lambda line: line[1][-1])
    yield from rest


def sort(counts: np.ndarray, last: np.ndarray, entries: Codes) -> Codes:
    """Return codes of `sorted_record`.

    counts: [J] entries of each job
    last: [J] whether the job is the last of its group
    entries: [N] codes of `entry_record`, job after job
    """
    ends = np.cumsum(counts).astype(int)
    assert (ends[-1] if len(ends) else 0) == len(entries["key"])
    order = np.concatenate(
        [np.zeros(0, int)]
        + [
            np.argsort(entries["key"][end - count : end], kind="stable") + end - count
            for end, count in zip(ends, np.asarray(counts, int), strict=True)
        ]
    )
    marks = ends[np.asarray(last, bool)]  # a mark is inserted before the next group
    given = {name: np.insert(entries[name][order], marks, 0) for name in ("splat", "mask")}
    given["end"] = np.insert(np.zeros(len(order), np.uint8), marks, 1)
    return given


def sub_sort(batches: Sequence[np.ndarray]) -> Codes:
    """Return codes of `ranked_record` for the keys [n] of each batch in arrival order."""
    orders = [np.argsort(keys, kind="stable") for keys in batches]
    return {
        "key": np.concatenate([keys[order] for keys, order in zip(batches, orders, strict=True)]),
        "index": np.concatenate(orders).astype(np.uint16),
        "last": np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches]),
    }
