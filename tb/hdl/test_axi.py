"""Memory port: order and throughput (`tb.formal.axi_master` proves the rest); the registers under
`cocotbext-axi`."""

import numpy as np
import pytest

from splatcore.hdl.memory.axi import CROWD, Axi
from splatcore.hdl.registers import Registers
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.spec.axi import PREPROCESSING, READERS, RENDERING, WRITERS, read_record, write_record
from splatcore.spec.config import DEFAULT
from tb.helpers.configs import wide_addresses
from tb.helpers.runs import compiled

pytestmark = pytest.mark.slow

WIDE = wide_addresses(DEFAULT)


@pytest.mark.parametrize(
    "config, seed",
    [(DEFAULT, 0), (WIDE, 0), pytest.param(DEFAULT, 1, marks=pytest.mark.verify)],
    ids=["usual", "wide", "seed 1"],
)
def test_registers_under_cocotbext(config, seed):
    """A host at the registers' AXI4-Lite, also with registers for windows of 64-bit addresses."""
    run_testbench(
        Registers(config), "tb.testbenches.registers", seed=seed, address_bits=config.address_bits
    )


WIRES = ("arready", "awready", "wready", "bvalid", "bid", "bresp", "rvalid", "rid", "rlast")
WIRES += ("rdata", "rresp")
NAMES = ("arvalid", "arid", "wvalid", "wlast", "awvalid", "awid")


def run(reads: int = 0, writes: int = 0, beats: int = 1, favoured: int = 0, patient: int = 0):
    """Run `reads` bursts per reader and `writes` per writer, of `beats` beats each, before a memory
    that takes all and answers nothing; samples of the port's wires by name."""
    rng = np.random.default_rng(0)

    def rows(record, count, **codes):
        fields = {"beat": rng.integers(0, 1 << 20, count), "length": np.full(count, beats - 1)}
        return record.pack(fields | codes)

    count = writes * beats
    data = {f"data{k}": rng.integers(0, 1 << 63, count) for k in range(DEFAULT.port // 64)}
    data["strobe"] = np.full(count, (1 << DEFAULT.port // 8) - 1)
    narrow = np.zeros(reads, int)
    inputs = {f"reads__{k}": rows(read_record(), reads, narrow=narrow) for k in range(len(READERS))}
    record = write_record(DEFAULT)
    inputs |= {f"writes__{k}": rows(record, count, **data) for k in range(len(WRITERS))}
    constants = {f"m_axi__{name}": name.endswith("ready") for name in WIRES}
    constants |= {"failing": 0, "favoured": favoured, "patient": patient}
    simulation = compiled(Axi, DEFAULT, samples=tuple(f"m_axi__{name}" for name in NAMES))
    samples = simulation.run(inputs, constants=constants, cycles_max=1400).samples
    return {name: samples[f"m_axi__{name}"] for name in NAMES}


def gaps(signal: np.ndarray) -> int:
    """Return the number of cycles between the first and the last 1 that are not 1."""
    found = np.flatnonzero(signal)
    return int(found[-1] - found[0] + 1 - len(found))


def served(found: dict[str, np.ndarray], channel: str) -> np.ndarray:
    """The client of each burst of "ar" or "aw", in order."""
    return found[f"{channel}id"][found[f"{channel}valid"] == 1]


def check_turns(clients: np.ndarray, count: int):
    """Check that all clients are served in turns."""
    assert (np.sort(clients.reshape(-1, count), axis=1) == np.arange(count)).all()


def test_a_read_every_cycle():
    found = run(reads=60)
    assert found["arvalid"].sum() == 60 * len(READERS) and gaps(found["arvalid"]) == 0
    check_turns(served(found, "ar"), len(READERS))


@pytest.mark.parametrize("half", [PREPROCESSING, RENDERING])
def test_a_half_comes_first(half):
    """Writes of the favoured half come before those of the other half, patient writers last."""
    patient = list(WRITERS.values()).index(half)
    order = served(run(writes=40, favoured=1 << half, patient=1 << patient), "aw")
    rank = np.array([of != half for of in WRITERS.values()]) + 0
    rank[patient] = 2
    assert (np.bincount(order, minlength=len(WRITERS)) == 40).all()
    assert (np.diff(rank[order]) >= 0).all()


def test_patient_writers_wait_for_reads():
    """They begin no burst while a half has `CROWD` reads in flight; other writers go on."""
    most = max(np.bincount(list(READERS.values())))
    patient = list(WRITERS.values()).index(RENDERING)
    for reads, begun in (((CROWD - 1) // most, 60), (-(-CROWD // most), 0)):
        order = served(run(reads=reads, writes=60, patient=1 << patient), "aw")
        count = np.bincount(order, minlength=len(WRITERS))
        assert (np.delete(count, patient) == 60).all() and count[patient] == begun


@pytest.mark.parametrize("beats", [1, 2, 5])
def test_a_beat_written_every_cycle(beats):
    found = run(writes=40, beats=beats)
    valid, last = found["wvalid"], found["wlast"]
    assert valid.sum() == 40 * len(WRITERS) * beats and gaps(valid) == 0
    assert (np.flatnonzero(last[valid == 1]) % beats == beats - 1).all()
    assert (last & valid).sum() == found["awvalid"].sum() == 40 * len(WRITERS)
    check_turns(served(found, "aw"), len(WRITERS))
