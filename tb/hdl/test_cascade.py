"""A cascade of merges, and a sorter around it, against a stable sort; throughput and releases."""

import numpy as np
import pytest

from splatcore.hdl.sorting.cascade import Cascade
from splatcore.hdl.sorting.sorter import Sorter
from splatcore.sim.cycles.sort import merged
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import TINY
from splatcore.spec.sort import batch_record, ranked_record, way_bits
from tb.formal import sorter
from tb.formal.cascade import FAULTS
from tb.helpers.configs import machines
from tb.helpers.runs import compiled, faults_are_found
from tb.stages.sorting import KEYS, batch_case, batches_of

CASCADES = machines("DEFAULT TINY cascade_4 cascade_512")


def run(name: str, batches: list[np.ndarray], part=None, **options):
    """Run, and compare with the golden model."""
    config = CASCADES[name]
    part = part or compiled(Cascade, config)
    return batch_case(config, batches).check(part, idle_max=2000, **options)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASCADES)
def test_equals_stable_sort(name):
    """Batches of every size, with ties, with and without stalls."""
    for seed, stall in enumerate((0, 0.3, 0.7)):
        run(name, batches_of(CASCADES[name], 40, seed), stall=stall, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["DEFAULT", "TINY"])
@pytest.mark.parametrize("kind", KEYS)
def test_one_entry_per_cycle(kind, name):
    """For any keys: full batches follow each other without gaps; a single one as in the model."""
    config, random = CASCADES[name], np.random.default_rng(1)
    size = config.sub_sorter_entries
    keys = [KEYS[kind](config.sort_key_bits, size, random) for _ in range(6)]
    assert run(name, keys).cycles == 7 * size + merged(size, size) - 1
    for count in (1, 2, 3, size // 2, size // 2 + 1, size - 1, size):
        keys = KEYS[kind](config.sort_key_bits, count, random)
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
    batches = [KEYS[kind](config.sort_key_bits, size, random) for size in sizes]
    owner = np.repeat(np.arange(len(sizes)), sizes)
    to = (np.arange(len(sizes)) % config.merge_ways) + (np.array(halves) << way_bits(config))
    case = batch_case(config, batches)
    inputs = sent(case.inputs["i"], batch_record(config).width, to[owner])
    wanted = sent(case.expected["o"], ranked_record(config).width, to[owner])
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
@pytest.mark.parametrize("kind", KEYS)
def test_release_drops_batches_inside(kind):
    """After a release, no entry of the half's earlier batches comes; later batches come whole."""
    check_release(kind, compiled(Sorter, TINY))


SLOWER = "a dropped one waits"  # costs cycles only: a proof finds it

RELEASES = {name: fault for name, fault in sorter.FAULTS.items() if name != SLOWER}


def check_releases(part: Simulation, fault: int):
    """Check that passes without a fault and fails with each one."""
    check_release("random", part, fault=fault)


test_fault_at_a_release_is_found = faults_are_found(lambda: Sorter(TINY), RELEASES, check_releases)


def check_all(part: Simulation, fault: int):
    """Check that passes without a fault and fails with each one."""
    for seed, stall in enumerate((0, 0.5)):
        batches, constants = batches_of(TINY, 40, seed), {"fault": fault}
        run("TINY", batches, part, stall=stall, seed=seed, constants=constants)


test_fault_is_found = faults_are_found(lambda: Cascade(TINY), FAULTS, check_all)
