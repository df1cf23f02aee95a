"""Sub-sorters, a cascade of merges or OR-trees, against a stable sort; cycles. `tb.formal` proves
drops and releases."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.eda.gates.synth import DEPTH_MAX, gates
from splatcore.hdl.sorting.cascade import Cascade
from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.sim.cycles.sort import merged
from splatcore.sim.rtl.streams import Result
from splatcore.spec.config import TINY, Config
from splatcore.spec.sort import digits, phases
from tb.helpers.configs import machines
from tb.helpers.runs import compiled
from tb.stages.sorting import KEYS, batch_case, batches_of

CASCADES = machines("DEFAULT TINY cascade_4 cascade_512")
TREES = machines("DEFAULT PAPER short TINY NARROW largest digits uneven pairs")
LONG = ("PAPER", "largest")
"""Sizes of OR-trees that take minutes to compile; "short" and "NARROW" are the same with fewer
entries."""


def run(kind: type, config: Config, batches: list[np.ndarray], **options) -> Result:
    """Run a sub-sorter, and compare with the golden model."""
    constants = {"drop": 0} if kind is SubSorter else {}
    part = compiled(kind, config)
    result = batch_case(config, batches, **constants).check(part, **options)
    assert kind is Cascade or result.ports["idle"]
    return result


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind, config",
    [
        *(pytest.param(Cascade, config, id=f"cascade {k}") for k, config in CASCADES.items()),
        *(
            pytest.param(SubSorter, c, id=f"trees {k}", marks=[pytest.mark.verify] * (k in LONG))
            for k, c in TREES.items()
        ),
    ],
)
def test_equals_stable_sort(kind, config):
    """Batches of every size, with ties, with and without stalls."""
    for seed, stall in enumerate((0, 0.3, 0.7)):
        run(kind, config, batches_of(config, 40, seed), stall=stall, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DEFAULT", "TINY"])
@pytest.mark.parametrize("kind", KEYS)
def test_one_entry_per_cycle(kind, name):
    """For any keys: full batches follow each other without gaps; a single one as in the model."""
    config, random = CASCADES[name], np.random.default_rng(1)
    size = config.sub_sorter_entries
    keys = [KEYS[kind](config.sort_key_bits, size, random) for _ in range(6)]
    assert run(Cascade, config, keys).cycles == 7 * size + merged(size, size) - 1
    for count in (1, 2, 3, size // 2, size // 2 + 1, size - 1, size):
        keys = KEYS[kind](config.sort_key_bits, count, random)
        last_in = count - 1 + merged(size, count)
        assert last_in + count <= run(Cascade, config, [keys]).cycles <= last_in + count + size // 4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DEFAULT", "short", "pairs"])
@pytest.mark.parametrize("kind", KEYS)
def test_two_cycles_per_entry(kind, name):
    """For any keys: loading, each phase once, then 2 cycles per entry."""
    config, random = TREES[name], np.random.default_rng(1)
    for count in (1, 2, config.sub_sorter_entries // 2 + 1, config.sub_sorter_entries):
        keys = KEYS[kind](config.sort_key_bits, count, random)
        fill = 2 * len(phases(config))
        assert run(SubSorter, config, [keys]).cycles == count + fill + 2 * (count - 1) + 1
        batch = 3 * count + fill - 2  # the next one may come as soon as the last entry is chosen
        assert run(SubSorter, config, [keys] * 5).cycles == 5 * batch + 1


@pytest.mark.verify
def test_no_path_is_too_deep():
    """`phases` splits the digits so that each part fits in a cycle."""
    for widths in ((1,) * 23, (2,) * 12, (4, 4)):
        config = replace(TINY, sub_sorter_entries=32, sort_digits=widths)
        assert gates(SubSorter(config)).speed_depth <= DEPTH_MAX


@pytest.mark.parametrize("machine", TREES.values(), ids=TREES)
def test_phases_hold_every_digit_once(machine):
    found = [digit for phase in phases(machine) for cycle in phase for digit in cycle]
    assert found == digits(machine)
    assert sum(width for _, width in found) == machine.sort_key_bits and found[-1][0] == 0
