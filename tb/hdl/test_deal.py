"""Stage 2's front end against its golden model: rounds, buckets, jobs."""

import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.sorting.deal import Deal
from splatcore.sim.cycles.sort import stage_cycles
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.sort import half_entries
from splatcore.study.bench.sort_parts import KEYS, SortStage
from tb.helpers.configs import MACHINES
from tb.helpers.parts import forward
from tb.helpers.runs import compiled, faults_are_found
from tb.planted.fault import planted_in
from tb.stages.sorting import deal_case, entries_for, spill_case

KINDS = (*KEYS, "tied")


def check(name: str, kind: str, counts, stall: float = 0, seed: int = 0):
    config = MACHINES[name]
    case = deal_case(config, counts, entries_for(config, kind, counts, seed))
    part = compiled(Deal, config)
    return case.check(part, f"{kind} {counts}: ", stall=stall, seed=seed, idle_max=3000)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stall", [0, 0.4])
def test_tiny_equals_golden(kind, stall):
    half = half_entries(TINY)
    check("TINY", kind, [3, half, half + 1, 1, 300, 5, 1000, 70, 2 * half, 4], stall)


@pytest.mark.parametrize("stall", [0, 0.4])
def test_default_equals_golden(stall):
    for seed, kind in enumerate(KINDS):
        check("DEFAULT", kind, [2048, 2049, 5, 5200, 7000], stall, seed)


def check_stage(name: str, kind: str, counts, part=None, seed: int = 0, **options):
    """Check dealing, scratch memory and sorting together: every entry in its place."""
    config = MACHINES[name]
    case = spill_case(config, counts, entries_for(config, kind, counts, seed))
    part = part or compiled(SortStage, config)
    return case.check(part, f"{kind} {counts}: ", seed=seed, idle_max=100_000, **options)


MIXED = (70, 3, 64, 65, 130, 300, 5, 129, 1, 66, 1000, 64, 70)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_stage_equals_golden(kind):
    """Areas of scratch memory are not written while they are read, whichever side stalls."""
    for seed, stall in enumerate((0, 0.3, 0.7)):
        check_stage("TINY", kind, MIXED, stall=stall, seed=seed)
        check_stage("TINY", kind, [100] * 12, stall=stall, seed=seed)


@pytest.mark.verify
@pytest.mark.parametrize("kind", KINDS)
def test_default_stage_equals_golden(kind):
    check_stage("DEFAULT", kind, [20_000, 3, 2049, 5000])


@pytest.mark.verify
@pytest.mark.parametrize("kind", KINDS)
def test_cycles_of_long_lists(kind):
    """Cycles are within 3 % of the cycle model's."""
    for counts in ([2100], [5200] * 3, [3000, 500] * 4, [20_000]):
        entries = entries_for(DEFAULT, kind, counts, 0)
        found = check_stage("DEFAULT", kind, counts).cycles
        lists = np.split(entries["key"], np.cumsum(counts)[:-1])
        assert abs(stage_cycles(DEFAULT, lists) - found) <= 0.03 * found, counts


FAULTS = planted_in(
    Deal,
    _areas={"an area is written too early": ("~used.room", "0")},
    _give={
        "a round ends with each job": ("self.total, 0, 0)", "self.total, 0, 1)"),
        "a job too long": ("<= self.half", "<= self.half + 3"),
        "an empty bucket ends a job": ("room | ~count.any()", "room"),
    },
    _entry={
        "an issued entry is dealt again": ("(key < self.low) | of_low", "of_low"),
        "equal keys are not skipped": ("(key < self.low) | of_low", "key < self.low"),
        "a bucket keeps too little": ("self.count < self.half)", "self.count < self.half - 1)"),
    },
    _memories={
        "keys below the base wrap": ("Mux(offset[-1], 0, within)", "within"),
        "a count just written is read": (
            "Mux(self.again, self.counted, found_count)",
            "found_count",
        ),
        "any entry before is in the same bucket": ("(self.looked_up == at)", "1"),
        "a full bucket counts on": ("written.eq(write.en)", "written.eq(self.through)"),
    },
    _keys={
        "the first bucket begins at the base": ("self.bucket.any() & ", ""),
        "buckets as narrow as can be": ("Mux(wanted < shift, wanted, shift)", "shift"),
        "buckets never wider": ("self.shift + 1", "self.shift"),
        "a bucket's keys are equal if all are": ("self.high == self.low", "~self.extent.any()"),
    },
    _lines={
        "a bucket has no last line": ("ending & begun", "0"),
        "a slot just written is read": ("Mux(self.again, self.before, slots[-1])", "slots[-1]"),
    },
)


class Held(wiring.Component):
    """`SortStage`, whose output is blocked until `hold` falls."""

    def __init__(self, config):
        self.inner = SortStage(config)
        super().__init__(dict(self.inner.signature.members) | {"hold": In(1)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = inner = self.inner
        forward(m, self, inner)
        m.d.comb += self.o.valid.eq(inner.o.valid & ~self.hold)
        m.d.comb += inner.o.ready.eq(self.o.ready & ~self.hold)
        return m


def check_all(part: Simulation):
    """Check that fails with each fault."""
    for seed, stall in enumerate((0, 0.5)):
        for kind in ("equal", "clustered", "random", "tied"):
            check_stage("NARROW", kind, MIXED, part, seed, stall=stall, constants={"hold": 0})
    constants = {"hold": np.append(np.ones(8000, np.uint64), 0)}
    check_stage("NARROW", "clustered", [65] * 24, part, constants=constants)


test_fault_is_found = faults_are_found(lambda: Held(MACHINES["NARROW"]), FAULTS, check_all)
