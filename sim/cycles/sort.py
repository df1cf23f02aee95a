"""Cycle model of stage 2: when rounds, jobs and groups end, independent of the keys."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from splatcore.golden.sort import Job, Round, jobs
from splatcore.hdl.sorting.cascade import latency
from splatcore.hdl.sorting.deal import JOBS_WAITING
from splatcore.spec.config import Config
from splatcore.spec.sort import AREAS, BUCKETS, phases

# Cycles between events, from the machine's registers and states.
OPENED = 2  # from a job's half being free to its first entry
RUN_TO_MERGE = 4  # from a run's first entry leaving its sub-sorter to merging it
BEGUN = 3  # from the beginning of a merge to its first entry, plus one per run
MARKED = 4  # from the last entry of a merge to the transfer of the group's mark
RELEASED = 5  # from the last entry of a merge to the half and the merge being free
DEALT = 1  # per entry and round, with memory that accepts lines at once
LOOKED_UP = 2  # per bucket, to write its last line
ISSUED = 3  # per bucket, to issue it
ROUND = 8  # per round in addition, plus the memory's latency
LISTED = 4  # minimum per bucket

Consume = Callable[[float, int], float]
"""(cycle in which a job's first entry can be merged, number of entries) → cycle of the last."""


def at_once(first: float, count: int) -> float:
    """A consumer that is always ready: one entry per two cycles."""
    return first + 2 * (count - 1)


class Timeline:
    """Cycles at which the parts of stage 2 are free, from the acceptance of the first group on.

    pace: cycles per entry read from memory
    latency: of memory, in cycles
    consume: timing of the consumer of sorted entries
    dealt: cycles per dealt entry and round
    """

    def __init__(
        self,
        config: Config,
        pace: float = 1,
        latency: int = 0,
        consume: Consume = at_once,
        dealt: float = DEALT,
    ):
        self.config, self.dealt = config, dealt
        self.pace, self.latency, self.consume = pace, latency, consume
        self.deal = self.load = self.merge = self.marked = self.half = self.turn = 0
        self.halves, self.sorters = [0, 0], [0] * config.sub_sorters
        self.areas = deque([0] * AREAS)  # when each is free again
        self.loads = deque([0] * JOBS_WAITING)  # when the last jobs were accepted

    def group(self, found: Job | list[Round]):
        """Sort the next group: one job, or rounds of jobs."""
        if isinstance(found, Job):
            self.deal += 1
            last = self._job(len(found.order), self.pace * len(found.order))
        else:
            count = sum(len(job.order) for part in found for job in part.jobs)
            for part in found:
                last = self._round(part, count)
        self.marked = last + MARKED

    def _round(self, part: Round, count: int) -> float:
        """Deal a list of `count` entries and merge the round's jobs; cycle of the last entry."""
        begin = max(self.deal, self.areas.popleft())
        dealt = max(self.pace, self.dealt) * count + ROUND + self.latency
        written = begin + dealt + LOOKED_UP * BUCKETS
        last = begin
        for job in part.jobs:
            self.deal = written + ISSUED * (job.buckets[-1][0] + 1)
            last = self._job(len(job.order), max(len(job.order), LISTED * len(job.buckets)))
        self.deal = max(self.deal, written + ISSUED * BUCKETS)
        self.areas.append(last + RELEASED) if part.jobs else self.areas.appendleft(begin)
        return last

    def _job(self, entries: int, arrival: float) -> float:
        """Form a job's runs and merge them; cycle of the last merged entry.

        arrival: cycles until all its entries have arrived
        """
        size, pace = self.config.sub_sorter_entries, arrival / max(entries, 1)
        self.deal = max(self.deal, self.loads.popleft())
        self.load = max(self.load, self.deal + self.latency, self.halves[self.half]) + OPENED
        self.loads.append(self.load)
        batches = [min(size, entries - start) for start in range(0, entries, size)]
        first = 0
        for batch in batches:
            out = self._sort(batch, batch * pace)
            first = out + RUN_TO_MERGE
        self.load += 1
        first = max(first, max(self.load, self.merge) + BEGUN + len(batches))
        last = self.consume(first, entries)
        self.merge = self.halves[self.half] = last + RELEASED
        self.half = 1 - self.half
        return last

    def _sort(self, batch: int, arrival: float) -> float:
        """Sort a batch in the next sub-sorter; the cycle in which its first entry leaves.

        arrival: cycles until all its entries have arrived
        """
        sorter, size = self.turn, self.config.sub_sorter_entries
        self.turn = (self.turn + 1) % self.config.sub_sorters
        if self.config.sub_sorter == "trees":  # holds one batch at a time
            self.load = max(self.load, self.sorters[sorter]) + arrival
            out = self.load + 2 * len(phases(self.config))
            self.sorters[sorter] = out + 2 * batch - 1
        else:
            self.load += arrival
            out = max(self.load + merged(size, batch), self.sorters[sorter])
            self.sorters[sorter] = out + batch
        return out


@cache
def merged(size: int, count: int) -> int:
    """Cycles from a batch's last input entry to its first output of a cascade for `size` entries.

    count: entries of the batch
    """
    times, length = list(range(count)), 1  # when each entry arrives at the next merge
    while length < size:
        out, last, delay = [], 0, latency(length)
        for start in range(0, count, 2 * length):
            first, second = times[start:][:length], times[start + length :][:length]
            begin = second[0] + delay if second else max(first[0] + delay, first[-1] + 1)
            for arrival in first + second:
                last = max(last + 1, begin, arrival + delay)
                out.append(last)
        times, length = out, 2 * length
    return times[0] - (count - 1)


def cycles(config: Config, counts: Sequence[int]) -> int:
    """Cycles of stage 2 for groups of one job each, from the first acceptance to the last mark.

    counts: entries per group
    Assumes streams that are always valid and ready. Within 3 % of the hardware for any keys.
    """
    timeline = Timeline(config)
    for count in counts:
        timeline.group(Job(np.arange(count), True))
    return int(timeline.marked)


def stage_cycles(config: Config, lists: Sequence[np.ndarray]) -> int:
    """The same for lists with these keys; long lists are dealt, memory answers at once."""
    timeline = Timeline(config)
    for found in jobs(config, lists):
        timeline.group(found)
    return int(timeline.marked)
