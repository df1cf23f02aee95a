"""Stage 2 against its golden model: order, marks, stops, cycles."""

from itertools import product

import numpy as np
import pytest

from splatcore.golden.sort import sort
from splatcore.hdl.sorting.runs import Half, Runs
from splatcore.hdl.sorting.sort import COUNTED, Sort
from splatcore.sim.cycles.sort import cycles
from splatcore.sim.rtl.streams import Result, Simulation
from splatcore.spec.config import TINY
from splatcore.spec.group import sorted_record
from splatcore.spec.sort import half_entries
from splatcore.study.bench.sort import BOUND, BOUND_FROM
from splatcore.study.bench.sort_parts import KEYS, entries_of
from tb.helpers.configs import MACHINES, machines
from tb.helpers.runs import compiled, counters, faults_are_found, marked
from tb.planted.fault import planted_in
from tb.stages.sorting import sort_case

SORTERS = machines("TINY DEFAULT four one three")
LARGE = ("four", "three")  # only `make verify` compiles these

SAMPLES = ("o__valid", "o__payload")

MIXED = (30, 5, 0, 0, 64, 63, 1, 33, 57, 16, 17, 15, 48)
"""Lengths around a batch and a half of TINY."""


def check(name: str, kind: str, counts, part=None, last=1, **options) -> Result:
    """Run, and compare every stream with the golden model's. last: per job, it ends a group."""
    config = MACHINES[name]
    entries = entries_of(config, kind, counts, options.get("seed", 0))
    part = part or compiled(Sort, config, samples=SAMPLES)
    case = sort_case(config, counts, entries, last)
    return case.check(part, f"{kind} {counts}: ", idle_max=3000, **options)


def groups_of(counts, seed: int = 0) -> np.ndarray:
    """Return one bit per job: a group ends with it, at random; the last job always ends one."""
    return np.append(np.random.default_rng(seed).integers(0, 2, len(counts) - 1), 1)


def test_golden_in_small():
    """The golden model on a group of two jobs and one without entries, with known results."""
    keys = np.array([3, 1, 2, 1, 5, 4], np.uint64)
    entries = {"key": keys, "splat": np.arange(6), "mask": np.arange(6) + 10}
    found = sort(np.array([4, 2, 0]), np.array([0, 1, 1]), entries)
    assert list(found["splat"]) == [1, 3, 2, 0, 5, 4, 0, 0]
    assert list(found["mask"]) == [11, 13, 12, 10, 15, 14, 0, 0]
    assert list(np.flatnonzero(found["end"])) == [6, 7]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KEYS)
def test_tiny_equals_golden(kind):
    """Lengths around the sizes of batches and halves, with and without stalls."""
    for count in (0, 1, 2, 15, 16, 17, 31, 63, 64):
        check("TINY", kind, [count])
    for seed, stall in enumerate((0, 0.2, 0.5, 0.8)):
        check("TINY", kind, MIXED, stall=stall, seed=seed)
        check("TINY", kind, MIXED, stall=stall, seed=seed, last=groups_of(MIXED, seed))
        check("TINY", kind, [16] * 12 + [40] * 12, stall=stall, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(["one", "three"], LARGE))
def test_other_sizes_equal_golden(name):
    half = half_entries(MACHINES[name])
    for seed, (kind, stall) in enumerate(product(KEYS, (0, 0.4))):
        counts = [min(count, half) for count in (*MIXED, 700)]
        check(name, kind, counts, stall=stall, seed=seed, last=groups_of(counts, seed))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KEYS)
@pytest.mark.parametrize("name", marked(["DEFAULT", "four"], LARGE))
def test_whole_halves_equal_golden(name, kind):
    config = MACHINES[name]
    half = half_entries(config)
    counts = [half, half - 1, 3, config.sub_sorter_entries, min(1300, half), 0, half]
    check(name, kind, counts, last=groups_of(counts))
    check(name, kind, counts, stall=0.4, seed=3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KEYS)
@pytest.mark.parametrize("name", marked(SORTERS, LARGE))
def test_cycles_of_a_list(name, kind):
    """Within `BOUND` (except with a single sub-sorter) and 3 % of the model, for any keys."""
    config = MACHINES[name]
    half = half_entries(config)
    for count in (1, 2, 16, 17, 63, 64, 100, 129, 200, 256, 500, 1000, 1300, 2048):
        if count <= half:
            found = check(name, kind, [count]).cycles
            assert abs(found - cycles(config, [count])) <= max(2, 0.03 * found), count
            if count >= BOUND_FROM and config.sub_sorters > 1:
                assert found <= BOUND * count


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(SORTERS, ["four"]))
def test_cycles_of_many_groups(name):
    """As in the model; 2 per entry and some per group, if one sub-sorter loads as another sends."""
    config, random = MACHINES[name], np.random.default_rng(5)
    drawn = list(random.integers(0, half_entries(config), 20))
    for counts in ([10] * 30, [50] * 30, [500] * 10, [1300] * 8, drawn):
        counts = [min(count, half_entries(config)) for count in counts]
        found = check(name, "random", counts).cycles
        assert abs(found - cycles(config, counts)) <= 0.03 * found
        if len(set(counts)) == 1 and config.sub_sorters > 1:
            first = cycles(config, counts[:1])  # no other group overlaps with it
            runs = -(-counts[0] // config.sub_sorter_entries)
            assert found <= first + (2 * counts[0] + 2 * runs + 8) * len(counts)


@pytest.mark.slow
def test_counters():
    result = check("TINY", "random", MIXED, stall=0.3)
    counted = counters(COUNTED, result.ports["counters"])
    assert counted["entries"] == counted["given"] == sum(MIXED)
    assert 0 < counted["sorting"] < result.cycles
    assert 0 < counted["starved"] < result.cycles and counted["blocked"] > 0
    result = check("TINY", "random", [64] * 20)
    assert counters(COUNTED, result.ports["counters"])["blocked"] == 0  # only the consumer blocks


def marks_taken(result: Result) -> np.ndarray:
    """Return the cycles in which a mark was taken: it is gone in the next cycle."""
    end = sorted_record(TINY).offset("end")
    there = (result.samples["o__valid"] == 1) & (result.samples["o__payload"] >> end == 1)
    return np.flatnonzero(there & ~np.append(there[1:], False))


@pytest.mark.slow
@pytest.mark.parametrize("stall", [0, 0.4])
@pytest.mark.parametrize(
    ("counts", "last"),
    [((40, 64, 5, 30), (1, 1, 1, 1)), ((3, 64, 64, 50, 20, 64, 17), (1, 0, 0, 1, 1, 1, 1))],
)
def test_stop(counts, last, stall):
    """A stop in any cycle: the current group ends soon, in order; all others come whole."""
    case = sort_case(TINY, counts, entries_of(TINY, "clustered", counts), last)

    def run(stop) -> Result:
        constants = {"stop": np.array(stop, np.uint64), "clear": 0}
        return compiled(Sort, TINY, samples=SAMPLES).run(
            case.inputs, constants=constants, stall=stall, seed=1, idle_max=400
        )

    ends = np.flatnonzero(last)
    lengths = np.diff(np.append(0, np.cumsum(counts)[ends]))
    whole = np.split(case.expected["o"], np.cumsum(lengths)[:-1] + np.arange(1, len(ends)))
    never = marks_taken(run([0]))
    assert len(never) == len(ends)
    shortened = 0
    for moment in range(0, never[-1], 1 + never[-1] // 150):
        # Until the mark comes, a stop that is held for ever acts like one of the right length.
        held = marks_taken(run([0] * moment + [1]))
        group = int((held < moment).sum())
        result = run([0] * moment + [1] * (held[group] - moment + 1) + [0])
        marks = np.flatnonzero(result.outputs["o"][:, -1] >> 4)
        found = np.split(result.outputs["o"], marks + 1)
        assert len(found) == len(ends) + 1 and not len(found[-1]), moment
        for k, wanted in enumerate(whole):
            if k == group:
                assert np.array_equal(found[k][:-1], wanted[: len(found[k]) - 1]), moment
                assert np.array_equal(found[k][-1], wanted[-1])
            else:
                assert np.array_equal(found[k], wanted), (moment, k)
        shortened += len(found[group]) < len(whole[group])
        begun = group and held[group - 1] + lengths[group] < moment
        if begun and lengths[group] <= 64 and not stall:
            assert held[group] - moment <= 12
    assert shortened > 30


FAULTS = planted_in(
    Runs,
    _cut={"a batch too long": ("slot.index.all() | ", "")},
    _write={"a run in the wrong half": ("to.half == number", "to.half == 0")},
) | planted_in(
    Half, elaborate={"a half is not cleared": ("self.written.eq(0)", "self.written[0].eq(0)")}
) | planted_in(
    Sort,
    _control={
        "a mark behind each job": ("m.If(job.last)", "m.If(1)"),
        "a mark before its entries": (" & ~self.looking & ~self.found", ""),
    },
    _look={"no room is left": ("self.given.level + self.found", "self.given.level")},
)  # fmt: skip
"""Those of a merge and of a sorter are in `tb.formal`."""


def check_all(part: Simulation):
    """Check that fails with each fault."""
    for seed, stall in enumerate((0, 0.5)):
        for kind, counts in (("equal", [*MIXED, 64, 61]), ("clustered", [*MIXED, 30, 64])):
            check("NARROW", kind, counts, part, groups_of(counts, seed), stall=stall, seed=seed)


test_fault_is_found = faults_are_found(lambda: Sort(MACHINES["NARROW"]), FAULTS, check_all)
