"""A sub-sorter against a stable sort, and its cycles."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.eda.gates.synth import DEPTH_MAX, gates
from splatcore.golden.sort import sub_sort
from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.spec.config import TINY
from splatcore.spec.sort import digits, phases, ranked_record
from splatcore.study.bench.sort_parts import random_keys
from tb.helpers.configs import machines
from tb.helpers.runs import compiled
from tb.stages.sorting import KEYS, batch_case, batches_of

SUB_SORTERS = machines("DEFAULT PAPER short TINY NARROW largest digits uneven pairs")
LONG = ("PAPER", "largest")
"""Sizes that take minutes to compile; "short" and "NARROW" are the same with fewer entries."""


def run(name: str, batches: list[np.ndarray], **options):
    """Run, and compare with the golden model."""
    config = SUB_SORTERS[name]
    result = batch_case(config, batches, drop=0).check(compiled(SubSorter, config), **options)
    assert result.ports["idle"]
    return result


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(k, marks=pytest.mark.verify if k in LONG else ()) for k in SUB_SORTERS],
)
def test_equals_stable_sort(name):
    for seed, stall in enumerate((0, 0.3, 0.7)):
        run(name, batches_of(SUB_SORTERS[name], 40, seed), stall=stall, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DEFAULT", "short", "pairs"])
@pytest.mark.parametrize("kind", KEYS)
def test_two_cycles_per_entry(kind, name):
    """For any keys: loading, each phase once, then 2 cycles per entry."""
    config, random = SUB_SORTERS[name], np.random.default_rng(1)
    for count in (1, 2, config.sub_sorter_entries // 2 + 1, config.sub_sorter_entries):
        keys = KEYS[kind](config.sort_key_bits, count, random)
        fill = 2 * len(phases(config))
        assert run(name, [keys]).cycles == count + fill + 2 * (count - 1) + 1
        batch = 3 * count + fill - 2  # the next one may come as soon as the last entry is chosen
        assert run(name, [keys] * 5).cycles == 5 * batch + 1


@pytest.mark.slow
def test_drop():
    """A drop in any cycle discards the batch; the next one is sorted as if it were the first."""
    config, random = SUB_SORTERS["TINY"], np.random.default_rng(2)
    keys = random_keys(config.sort_key_bits, 13, random)
    rows = batch_case(config, [keys] * 3).inputs
    for moment in range(41):  # the first batch has gone by then
        drop = np.arange(moment + 2) == moment
        result = compiled(SubSorter, config).run(rows, constants={"drop": drop.astype(np.uint64)})
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


@pytest.mark.parametrize("machine", SUB_SORTERS.values(), ids=SUB_SORTERS)
def test_phases_hold_every_digit_once(machine):
    found = [digit for phase in phases(machine) for cycle in phase for digit in cycle]
    assert found == digits(machine)
    assert sum(width for _, width in found) == machine.sort_key_bits and found[-1][0] == 0
