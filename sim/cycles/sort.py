"""The cycle model of stage 2: times at which batches, jobs and groups end, whatever the keys."""

from collections.abc import Callable, Sequence

from splatcore.spec.config import Config
from splatcore.spec.sort import half_entries, phases

# Cycles between events, as the machine's registers and states make them.
OPENED = 1  # from a job's half being free to its first entry
RUN_TO_MERGE = 4  # from a run's first entry leaving its sub-sorter to its being merged
READ_TO_MERGE = 9  # from the first piece being asked for to its first entry being merged
BEGUN = 3  # from the beginning of a merge to its first entry, besides one for each run
MERGED = 4  # from the last entry of a merge to the beginning of the next one
MARKED = 6  # from the last entry of a merge to the group's mark being taken
RELEASED = 5  # from the last entry of a merge to the half and the merge being free
TURNED = 6  # from the last entry of a merge to the first piece of the next one being asked for


Give = Callable[[float, int], float]
"""The time at which the first of so many entries can be merged → that at which the last one is."""


def at_once(first: float, count: int) -> float:
    """Every second cycle an entry."""
    return first + 2 * (count - 1)


class Timeline:
    """Times at which the parts of stage 2 are free, in cycles from the first group's taking.

    pace: cycles that an entry takes to come. give: what becomes of a group's sorted entries.
    """

    def __init__(self, config: Config, pace: float = 1, give: Give = at_once):
        self.config, self.fill = config, 2 * len(phases(config))
        self.pace, self.give = pace, give
        self.load = self.merge = self.given = self.half = self.turn = 0
        self.halves, self.sorters = [0, 0], [0] * config.sub_sorters

    def group(self, count: int):
        """A group passes, as soon as the parts are free and its entries are there."""
        self.load += 1
        step = half_entries(self.config)
        jobs = [min(step, count - start) for start in range(0, count, step)] or [0]
        for number, entries in enumerate(jobs):
            last = self._job(entries, at_once if len(jobs) > 1 else self.give)
            if number < len(jobs) - 1:
                self._free(last + MERGED)
        if len(jobs) > 1:
            last = self._levels(last, count)
        self.given = last + MARKED
        self._free(last + RELEASED)

    def _free(self, time: int):
        self.merge = self.halves[self.half] = time
        self.half = 1 - self.half

    def _job(self, entries: int, give: Give) -> float:
        """Forms the runs of a job and merges them; returns when the last entry is merged."""
        size = self.config.sub_sorter_entries
        self.load = max(self.load, self.halves[self.half]) + OPENED
        batches = [min(size, entries - start) for start in range(0, entries, size)]
        first = 0
        for batch in batches:
            self.load = max(self.load, self.sorters[self.turn]) + batch * self.pace
            self.sorters[self.turn] = self.load + self.fill + 2 * batch - 1
            self.turn = (self.turn + 1) % self.config.sub_sorters
            first = self.load + self.fill + RUN_TO_MERGE
        self.load += 1
        first = max(first, max(self.load, self.merge) + BEGUN + len(batches))
        return give(first, entries)


def cycles(config: Config, counts: Sequence[int]) -> int:
    """Cycles that groups of so many entries take, from the first one's taking to the last's mark.

    Every stream is taken and given at once; within 3 % of the hardware for groups of any length,
    whatever the keys.
    """
    timeline = Timeline(config)
    for count in counts:
        timeline.group(int(count))
    return int(timeline.given)
