"""A cascade of merges, and a sorter around it, against a stable sort; throughput and releases."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.sort import sub_sort
from splatcore.hdl.sorting.cascade import Cascade, Pair
from splatcore.hdl.sorting.sorter import Sorter
from splatcore.sim.cycles.sort import merged
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import DEFAULT, TINY, Config
from splatcore.spec.sort import batch_record, ranked_record, way_bits
from tb.helpers.batches import KINDS, batches_of
from tb.helpers.runs import check_run, compiled
from tb.helpers.variants import faults_are_found

MACHINES = {
    "default": DEFAULT,
    "tiny": TINY,
    "four": replace(TINY, sub_sorter_entries=4, sort_digits=(1,) * 8),
    "largest": replace(TINY, sub_sorter_entries=512, sort_digits=(1,) * 8),
}


def rows_of(config: Config, batches: list[np.ndarray]) -> np.ndarray:
    last = np.concatenate([np.arange(len(keys)) == len(keys) - 1 for keys in batches])
    return batch_record(config).pack({"key": np.concatenate(batches), "last": last})


def run(name: str, batches: list[np.ndarray], stall: float = 0, seed: int = 0, part=None, **more):
    """Run, and compare with the golden model."""
    config = MACHINES[name]
    wanted = {"o": ranked_record(config).pack(sub_sort(batches))}
    part = part or compiled(Cascade, config)
    inputs = {"i": rows_of(config, batches)}
    return check_run(part, inputs, wanted, constants=more, stall=stall, seed=seed, idle_max=2000)


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_equals_stable_sort(name):
    """Batches of every size, with ties, with and without stalls."""
    for seed, stall in enumerate((0, 0.3, 0.7)):
        run(name, batches_of(MACHINES[name], 40, seed), stall, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["default", "tiny"])
@pytest.mark.parametrize("kind", KINDS)
def test_one_entry_per_cycle(kind, name):
    """For any keys: full batches follow each other without gaps; a single one as in the model."""
    config, random = MACHINES[name], np.random.default_rng(1)
    size = config.sub_sorter_entries
    keys = [KINDS[kind](config.sort_key_bits, size, random) for _ in range(6)]
    assert run(name, keys).cycles == 7 * size + merged(size, size) - 1
    for count in (1, 2, 3, size // 2, size // 2 + 1, size - 1, size):
        keys = KINDS[kind](config.sort_key_bits, count, random)
        last_in = count - 1 + merged(size, count)
        assert last_in + count <= run(name, [keys]).cycles <= last_in + count + size // 4


def sent(rows: np.ndarray, width: int, to: np.ndarray) -> np.ndarray:
    """Return rows of `width` bits with their target in the bits above."""
    wide = np.zeros((len(rows), 8), np.uint8)
    wide[:, : rows.shape[1]] = rows
    codes = wide.view("<u8")[:, 0] | to.astype(np.uint64) << np.uint64(width)
    return codes.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :4].copy()


def check_release(kind: str, part: Simulation, **more):
    """Check jobs of both halves, with a release of the first half in each cycle of the second's."""
    config, random = TINY, np.random.default_rng(2)
    sizes, halves = (16, 5, 1, 16, 9, 3, 16, 7), (0, 0, 0, 1, 1, 0, 0, 1)
    batches = [KINDS[kind](config.sort_key_bits, size, random) for size in sizes]
    sorted_, owner = sub_sort(batches), np.repeat(np.arange(len(sizes)), sizes)
    to = (np.arange(len(sizes)) % config.merge_ways) + (np.array(halves) << way_bits(config))
    inputs = sent(rows_of(config, batches), batch_record(config).width, to[owner])
    record = ranked_record(config)
    wanted = sent(record.pack(sorted_), record.width, to[owner])
    first, second = sum(sizes[:3]), sum(sizes[:5])
    cut = 0
    for moment in range(first, second):
        release = (np.arange(moment + 2) == moment).astype(np.uint64)
        result = part.run({"i": inputs}, constants={"release": release} | more)
        assert result.finished and result.ports["idle"], moment
        found = result.outputs["o"]
        given = len(found) - (len(wanted) - first)
        assert 0 <= given <= first, moment
        assert np.array_equal(found, np.concatenate([wanted[:given], wanted[first:]])), moment
        cut += given < first
    assert cut > 3


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_release_drops_batches_inside(kind):
    """After a release, no entry of the half's earlier batches comes; later batches come whole."""
    check_release(kind, compiled(Sorter, TINY))


RELEASES = {
    "nothing is dropped": (Sorter, "_batches", "inside.count - inside.goes", "0"),
    "all is dropped from then on": (Sorter, "_batches", "drops.eq(drops - 1)", "drops.eq(drops)"),
    "a batch is dropped too few": (Sorter, "_batches", "- inside.goes)\n", "- 1)\n"),
    "the other half's is dropped": (Sorter, "_batches", "dropped[1], dropped[0]", "*dropped"),
    "a batch goes to the first's": (Sorter, "_batches", "eq(i.payload.entry.last)", "eq(0)"),
}  # fmt: skip


def check_releases(part: Simulation, fault: int):
    """Check that passes without a fault and fails with each one."""
    check_release("random", part, fault=fault)


test_fault_at_a_release_is_found = faults_are_found(lambda: Sorter(TINY), RELEASES, check_releases)


FAULTS = {
    "a later entry wins a tie": (Pair, "_merge", "entry.key < first", "entry.key <= first"),
    "a run alone waits": (Pair, "_merge", "& ~pair.payload", ""),
    "a run too long": (Pair, "_push", "self.size - 1", "self.size"),
    "the next batch's runs are paired": (Pair, "_push", "~turn & ~i.payload.last", "~turn"),
    "a pair is not over": (Pair, "_merge", "second.payload.last & ~left[0]", "second.payload.last"),
    "a batch's end is lost": (Pair, "_merge", "pair.payload | Mux(", "Mux("),
    "the second run's index": (Pair, "_merge", "entry.index, chosen", "entry.index, 0"),
    "the second run's end is forgotten": (Pair, "_merge", "eq(second.payload.entry.last)", "eq(0)"),
}  # fmt: skip


def check_all(part: Simulation, fault: int):
    """Check that passes without a fault and fails with each one."""
    for seed, stall in enumerate((0, 0.5)):
        run("tiny", batches_of(TINY, 40, seed), stall, seed, part, fault=fault)


test_fault_is_found = faults_are_found(lambda: Cascade(TINY), FAULTS, check_all)
