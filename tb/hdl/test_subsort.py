"""A sub-sorter against a stable sort, its cycles, and proofs of a small one."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.eda.gates.synth import DEPTH_MAX, gates
from splatcore.golden.sort import sub_sort
from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.sim.rtl.formal import ProofError, cover, prove
from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.spec.sort import batch_record, digits, phases, ranked_record
from splatcore.study.bench.sort_rows import random_keys
from tb.formal.subsort import SIZES, Given, small
from tb.helpers.batches import KINDS, batches_of
from tb.helpers.runs import check_run, compiled
from tb.planted.fault import each, plant

MACHINES = {
    "default": DEFAULT,
    "paper": PAPER,
    "short": replace(PAPER, sub_sorter_entries=32),
    "tiny": TINY,
    "bits": replace(TINY, sort_digits=(1,) * 8),
    "largest": replace(PAPER, sub_sorter_entries=512, sort_digits=(1,) * 8),
    "narrow": replace(TINY, sort_digits=(4, 4)),
    "uneven": replace(DEFAULT, sub_sorter_entries=32, sort_digits=(1, 4, 2, 3, 5)),
    "pairs": replace(DEFAULT, sub_sorter_entries=32, sort_digits=(2,) * 11 + (1,)),
}
LONG = ("paper", "largest")
"""Sizes that take minutes to compile; "short" and "bits" are the same with fewer entries."""


def run(name: str, batches: list[np.ndarray], stall: float = 0, seed: int = 0):
    """Run, and compare with the golden model."""
    config = MACHINES[name]
    last = np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches])
    rows = batch_record(config).pack({"key": np.concatenate(batches), "last": last})
    wanted = {"o": ranked_record(config).pack(sub_sort(batches))}
    part = compiled(SubSorter, config)
    result = check_run(part, {"i": rows}, wanted, constants={"drop": 0}, stall=stall, seed=seed)
    assert result.ports["idle"]
    return result


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(k, marks=pytest.mark.verify if k in LONG else ()) for k in MACHINES],
)
def test_equals_stable_sort(name):
    for seed, stall in enumerate((0, 0.3, 0.7)):
        run(name, batches_of(MACHINES[name], 40, seed), stall, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["default", "short", "pairs"])
@pytest.mark.parametrize("kind", KINDS)
def test_two_cycles_per_entry(kind, name):
    """For any keys: loading, each phase once, then 2 cycles per entry."""
    config, random = MACHINES[name], np.random.default_rng(1)
    for count in (1, 2, config.sub_sorter_entries // 2 + 1, config.sub_sorter_entries):
        keys = KINDS[kind](config.sort_key_bits, count, random)
        fill = 2 * len(phases(config))
        assert run(name, [keys]).cycles == count + fill + 2 * (count - 1) + 1
        batch = 3 * count + fill - 2  # the next one may come as soon as the last entry is chosen
        assert run(name, [keys] * 5).cycles == 5 * batch + 1


@pytest.mark.slow
def test_drop():
    """A drop in any cycle discards the batch; the next one is sorted as if it were the first."""
    config, random = MACHINES["tiny"], np.random.default_rng(2)
    keys = random_keys(config.sort_key_bits, 13, random)
    last = np.arange(13) == 12
    rows = batch_record(config).pack({"key": keys, "last": last})
    for moment in range(41):  # the first batch has gone by then
        drop = np.arange(moment + 2) == moment
        result = compiled(SubSorter, config).run(
            {"i": np.concatenate([rows] * 3)}, constants={"drop": drop.astype(np.uint64)}
        )
        assert result.finished and result.ports["idle"], moment
        found = ranked_record(config).unpack(result.outputs["o"])
        taken, given = min(moment, 13), len(found["key"])
        # The rows up to the drop, or the entries not yet output, are lost; the rest is sorted.
        if moment < 13:
            batches = [keys[moment + 1 :], keys, keys]
        else:
            batches = [keys, keys]
            given -= 26
            assert 0 <= given < 13 and taken == 13
            first = sub_sort([keys])
            assert np.array_equal(found["index"][:given], first["index"][:given])
            found = {field: codes[given:] for field, codes in found.items()}
        wanted = sub_sort([batch for batch in batches if len(batch)])
        for field, codes in wanted.items():
            assert np.array_equal(found[field], codes), (moment, field)


@pytest.mark.verify
def test_no_path_is_too_deep():
    """`phases` splits the digits so that each part fits in a cycle."""
    for widths in ((1,) * 23, (2,) * 12, (4, 4)):
        config = replace(TINY, sub_sorter_entries=32, sort_digits=widths)
        assert gates(SubSorter(config)).speed_depth <= DEPTH_MAX


@pytest.mark.parametrize("machine", MACHINES.values(), ids=MACHINES)
def test_phases_hold_every_digit_once(machine):
    found = [digit for phase in phases(machine) for cycle in phase for digit in cycle]
    assert found == digits(machine)
    assert sum(width for _, width in found) == machine.sort_key_bits and found[-1][0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("entries", SIZES)
def test_small_one_is_proved(entries):
    prove(Given(small(entries)))
    cover(Given(small(entries)), depth=20)


FAULTS = {
    "a cluster is taken twice": ("elaborate", "~(leaving & takes", "~(0 & takes"),
    "the next cluster comes too early": ("elaborate", "takes & ~rest", "takes"),
    "the last entry is forgotten": ("elaborate", "rest, takes = ~self.single", "rest, takes = 0"),
    "a digit is not looked at": ("_clusters", "in digits:", "in digits[1:]:"),
    "the first cycle is not kept": ("_clusters", "s = self.halves[p]", "s = self.sets[p]"),
    "not the last one": ("elaborate", "self.single & ~any_of", "self.single | any_of"),
    "an offer is overwritten": ("elaborate", "second & (~self.o.valid | self.o.ready)", "second"),
    "a drop forgets the sets only": ("elaborate", "*self.full, second,", "second,"),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, SubSorter, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        prove(Given(small()))
