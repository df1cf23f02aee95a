"""Stage 2 in simulation."""

from dataclasses import replace
from functools import cache

from splatcore.hdl.sorting.sort import Sort
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import DEFAULT, PAPER, TINY

MACHINES = {
    "TINY": TINY,
    "DEFAULT": DEFAULT,
    "four": replace(TINY, sub_sorters=4, merge_ways=16, sort_digits=PAPER.sort_digits),
    "one": replace(TINY, sub_sorters=1, merge_ways=2, sort_digits=(1,) * 23),
    "three": replace(TINY, sub_sorters=3, merge_ways=8, sub_sorter_entries=32, sort_digits=(5, 3)),
}

SAMPLES = ("o__valid", "o__payload")


@cache
def simulation(name: str) -> Simulation:
    return Simulation(Sort(MACHINES[name]), SAMPLES)
