"""The cycle model of stage 2: times at which rounds, jobs and groups end, whatever the keys."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from splatcore.golden.sort import Job, Round, jobs
from splatcore.hdl.sorting.cascade import latency
from splatcore.hdl.sorting.deal import JOBS_WAITING
from splatcore.spec.config import Config
from splatcore.spec.sort import AREAS, BUCKETS, phases

# Cycles between events, as the machine's registers and states make them.
OPENED = 2  # from a job's half being free to its first entry
RUN_TO_MERGE = 4  # from a run's first entry leaving its sub-sorter to its being merged
BEGUN = 3  # from the beginning of a merge to its first entry, besides one for each run
MARKED = 4  # from the last entry of a merge to the group's mark being taken
RELEASED = 5  # from the last entry of a merge to the half and the merge being free
DEALT = 2  # of an entry in each round, with memory that takes lines at once
LOOKED_UP = 2  # a bucket's, for its last line to be written
GIVEN_OUT = 3  # a bucket's
ROUND = 8  # of a round besides, and the memory's latency
LISTED = 4  # a bucket's, however few entries it has

Give = Callable[[float, int], float]
"""The time at which the first of so many entries can be merged → that at which the last one is."""


def at_once(first: float, count: int) -> float:
    """Every second cycle an entry."""
    return first + 2 * (count - 1)


class Timeline:
    """Times at which the parts of stage 2 are free, in cycles from the first group's taking.

    pace: cycles that an entry of a short list, or of a list to be dealt, takes to come; latency: of
    memory. give: what becomes of a job's sorted entries. dealt: cycles of an entry in each round.
    """

    def __init__(
        self,
        config: Config,
        pace: float = 1,
        latency: int = 0,
        give: Give = at_once,
        dealt: float = DEALT,
    ):
        self.config, self.dealt = config, dealt
        self.pace, self.latency, self.give = pace, latency, give
        self.deal = self.load = self.merge = self.given = self.half = self.turn = 0
        self.halves, self.sorters = [0, 0], [0] * config.sub_sorters
        self.areas = deque([0] * AREAS)  # when they will be free again
        self.loads = deque([0] * JOBS_WAITING)  # when the last jobs were taken

    def group(self, found: Job | list[Round]):
        """A group passes, as soon as the parts are free and its entries are there."""
        if isinstance(found, Job):
            self.deal += 1
            last = self._job(len(found.order), self.pace * len(found.order))
        else:
            count = sum(len(job.order) for part in found for job in part.jobs)
            for part in found:
                last = self._round(part, count)
        self.given = last + MARKED

    def _round(self, part: Round, count: int) -> float:
        """Deals a list of so many entries, and merges the round's jobs."""
        begin = max(self.deal, self.areas.popleft())
        dealt = max(self.pace, self.dealt) * count + ROUND + self.latency
        written = begin + dealt + LOOKED_UP * BUCKETS
        last = begin
        for job in part.jobs:
            self.deal = written + GIVEN_OUT * (job.buckets[-1][0] + 1)
            last = self._job(len(job.order), max(len(job.order), LISTED * len(job.buckets)))
        self.deal = max(self.deal, written + GIVEN_OUT * BUCKETS)
        self.areas.append(last + RELEASED) if part.jobs else self.areas.appendleft(begin)
        return last

    def _job(self, entries: int, come: float) -> float:
        """Forms a job's runs and merges them; returns when the last entry is merged.

        come: cycles that its entries take to come.
        """
        size, pace = self.config.sub_sorter_entries, come / max(entries, 1)
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
        last = self.give(first, entries)
        self.merge = self.halves[self.half] = last + RELEASED
        self.half = 1 - self.half
        return last

    def _sort(self, batch: int, come: float) -> float:
        """A batch goes in; when its first entry leaves. come: cycles that its entries take."""
        sorter, size = self.turn, self.config.sub_sorter_entries
        self.turn = (self.turn + 1) % self.config.sub_sorters
        if self.config.sub_sorter == "trees":  # one batch at a time is in it
            self.load = max(self.load, self.sorters[sorter]) + come
            out = self.load + 2 * len(phases(self.config))
            self.sorters[sorter] = out + 2 * batch - 1
        else:
            self.load += come
            out = max(self.load + merged(size, batch), self.sorters[sorter])
            self.sorters[sorter] = out + batch
        return out


@cache
def merged(size: int, count: int) -> int:
    """Cycles from a batch's last entry to the first one out of a cascade for `size` entries."""
    times, length = list(range(count)), 1  # when each entry comes to the next merge
    while length < size:
        out, given, delay = [], 0, latency(length)
        for start in range(0, count, 2 * length):
            first, second = times[start:][:length], times[start + length :][:length]
            begin = second[0] + delay if second else max(first[0] + delay, first[-1] + 1)
            for come in first + second:
                given = max(given + 1, begin, come + delay)
                out.append(given)
        times, length = out, 2 * length
    return times[0] - (count - 1)


def cycles(config: Config, counts: Sequence[int]) -> int:
    """Cycles that jobs of so many entries, a group each, take, from the first one's taking to the
    last's mark.

    Every stream is taken and given at once; within 3 % of the hardware, whatever the keys.
    """
    timeline = Timeline(config)
    for count in counts:
        timeline.group(Job(np.arange(count), True))
    return int(timeline.given)


def stage_cycles(config: Config, lists: Sequence[np.ndarray]) -> int:
    """The same for lists with these keys, long ones dealt, with memory that answers at once."""
    timeline = Timeline(config)
    for found in jobs(config, lists):
        timeline.group(found)
    return int(timeline.given)
