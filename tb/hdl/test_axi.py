"""Memory port and registers under the models of `cocotbext-axi`; throughput and stray responses."""

import numpy as np
import pytest

from splatcore.hdl.memory.axi import CROWD, HALVES, OUTSTANDING_BITS, Axi
from splatcore.hdl.registers import Registers
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.sim.rtl.streams import Result
from splatcore.spec.axi import (
    ID_BITS,
    PREPROCESSING,
    READERS,
    RENDERING,
    WRITERS,
    read_record,
    write_record,
)
from splatcore.spec.config import DEFAULT, Config
from tb.helpers.configs import other_port, wide_addresses
from tb.helpers.runs import compiled

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.verify)])
@pytest.mark.parametrize("name, part", [("axi", Axi), ("registers", Registers)])
def test_under_cocotbext(name, part, seed):
    """Clients and a memory at the port; a host at the registers' AXI4-Lite."""
    under_cocotbext(part, name, DEFAULT, seed)


def under_cocotbext(part: type, name: str, config: Config, seed: int = 0):
    facts = {"port": config.port, "address_bits": config.address_bits}
    run_testbench(part(config), f"tb.testbenches.{name}", seed=seed, **facts)


def test_other_port_under_cocotbext():
    under_cocotbext(Axi, "axi", other_port(DEFAULT))


@pytest.mark.parametrize("name, part", [("axi", Axi), ("registers", Registers)])
def test_wide_addresses_under_cocotbext(name, part):
    """Bursts in two windows of 4 GiB, which alternate at each client in every cycle; registers."""
    under_cocotbext(part, name, wide_addresses(DEFAULT))


NAMES = ("arvalid", "arid", "wvalid", "wlast", "awvalid", "awid", "rready")
SAMPLES = (*(f"m_axi__{name}" for name in NAMES), "idle", "settled", "stray")
CYCLES = 1400
ASKED = 60  # bursts per reader; a half's counter has room for them


def run(
    reads: int = 0, writes: int = 0, beats: int = 1, favoured: int = 0, patient: int = 0, **port
) -> Result:
    """Run `reads` bursts per reader and `writes` per writer, of `beats` beats each.

    port: values of the port's inputs by name, others are 0
    """
    rng = np.random.default_rng(0)

    def rows(record, count, **codes):
        fields = {"beat": rng.integers(0, 1 << 20, count), "length": np.full(count, beats - 1)}
        return record.pack(fields | codes)

    count = writes * beats
    words = DEFAULT.port // 64
    data = {f"data{k}": rng.integers(0, 1 << 63, count) for k in range(words)}
    data["strobe"] = np.full(count, (1 << DEFAULT.port // 8) - 1)
    inputs = {
        f"reads__{k}": rows(read_record(), reads, narrow=np.zeros(reads, int))
        for k in range(len(READERS))
    }
    inputs |= {
        f"writes__{k}": rows(write_record(DEFAULT), count, **data) for k in range(len(WRITERS))
    }
    wires = ("arready", "awready", "wready", "bvalid", "bid", "bresp", "rvalid", "rid", "rlast")
    wires += ("rdata", "rresp")
    constants = {f"m_axi__{name}": port.get(name, 0) for name in wires}
    about = {"failing": 0, "favoured": favoured, "patient": patient}
    simulation = compiled(Axi, DEFAULT, samples=SAMPLES)
    return simulation.run(inputs, constants=constants | about, cycles_max=CYCLES)


def gaps(signal: np.ndarray) -> int:
    """Return the number of cycles between the first and the last 1 that are not 1."""
    found = np.flatnonzero(signal)
    return int(found[-1] - found[0] + 1 - len(found))


def test_a_read_every_cycle():
    found = run(reads=60, arready=1).samples
    valid, client = found["m_axi__arvalid"], found["m_axi__arid"]
    assert valid.sum() == 60 * len(READERS) and gaps(valid) == 0
    taken = client[valid == 1].reshape(-1, len(READERS))
    assert (np.sort(taken, axis=1) == np.arange(len(READERS))).all()  # in turns


@pytest.mark.parametrize("half", [PREPROCESSING, RENDERING])
def test_a_half_comes_first(half):
    """Writes of the favoured half come before those of the other half, patient writers last."""
    patient = list(WRITERS.values()).index(half)
    found = run(writes=40, favoured=1 << half, patient=1 << patient, awready=1, wready=1).samples
    order = found["m_axi__awid"][found["m_axi__awvalid"] == 1]
    rank = np.array([of != half for of in WRITERS.values()]) + 0
    rank[patient] = 2
    assert (np.bincount(order, minlength=len(WRITERS)) == 40).all()
    assert (np.diff(rank[order]) >= 0).all()


def test_patient_writers_wait_for_reads():
    """They begin no burst while a half has `CROWD` reads in flight; other writers go on."""
    most, patient = (
        max(np.bincount(list(READERS.values()))),
        list(WRITERS.values()).index(RENDERING),
    )
    for reads, begun in (((CROWD - 1) // most, 60), (-(-CROWD // most), 0)):
        found = run(reads=reads, writes=60, patient=1 << patient, arready=1, awready=1, wready=1)
        order = found.samples["m_axi__awid"][found.samples["m_axi__awvalid"] == 1]
        count = np.bincount(order, minlength=len(WRITERS))
        assert (np.delete(count, patient) == 60).all() and count[patient] == begun


@pytest.mark.parametrize("beats", [1, 2, 5])
def test_a_beat_written_every_cycle(beats):
    found = run(writes=40, beats=beats, awready=1, wready=1).samples
    valid, last = found["m_axi__wvalid"], found["m_axi__wlast"]
    assert valid.sum() == 40 * len(WRITERS) * beats and gaps(valid) == 0
    assert (np.flatnonzero(last[valid == 1]) % beats == beats - 1).all()
    assert (last & valid).sum() == found["m_axi__awvalid"].sum() == 40 * len(WRITERS)
    clients = found["m_axi__awid"][found["m_axi__awvalid"] == 1].reshape(-1, len(WRITERS))
    assert (np.sort(clients, axis=1) == np.arange(len(WRITERS))).all()


def answered(client: np.ndarray, seed: int, asked: int = ASKED) -> tuple[Result, dict]:
    """Have each reader request `asked` single beats, then return beats of `client` without a pause.

    Returns the run, and the port's inputs from the first beat on.
    """
    rng, count = np.random.default_rng(seed), len(client)
    first = asked * len(READERS) + 10
    answers = {
        "rid": np.append(np.zeros(first), client).astype(np.uint64),
        "rdata": rng.integers(0, 256, (first + count, DEFAULT.port // 8)).astype(np.uint8),
        "rlast": np.append(np.zeros(first), rng.integers(0, 2, count)).astype(np.uint64),
        "rvalid": np.repeat([0, 1, 0], [first, count, 1]).astype(np.uint64),
    }
    found = run(reads=asked, arready=1, **answers)
    assert (found.samples["m_axi__rready"] == 1).all()
    return found, {name: values[first:] for name, values in answers.items()}


def check_beats(found: Result, inputs: dict, k: int, mine: np.ndarray):
    """Check that reader k received these beats and no others."""
    beats = found.outputs[f"data__{k}"]
    assert (beats[:, :-1] == inputs["rdata"][mine]).all()
    assert (beats[:, -1] == inputs["rlast"][mine]).all()


def test_a_beat_read_every_cycle():
    client = np.random.default_rng(1).integers(0, len(READERS), 500)
    found, inputs = answered(client, 1)
    for k in range(len(READERS)):
        check_beats(found, inputs, k, client == k)
    assert not found.samples["stray"].any()


def test_beats_with_unknown_ids_are_dropped():
    """Beats with an ID that no reader has are reported as strays, and stall no other beat."""
    client = np.random.default_rng(2).integers(0, 1 << ID_BITS, 500)
    found, inputs = answered(client, 2)
    for k in range(len(READERS)):
        check_beats(found, inputs, k, client == k)
    strays = found.samples["stray"]
    assert len(READERS) < 1 << ID_BITS
    assert sorted(strays[strays != 0]) == sorted(1 | client[client >= len(READERS)] << 1)


def test_unrequested_beats_are_dropped():
    """A half without reads in flight takes no beat and stays idle; each beat is a stray."""
    client = np.random.default_rng(3).integers(0, len(READERS), 100)
    found, _ = answered(client, 3, asked=0)
    assert not any(len(found.outputs[f"data__{k}"]) for k in range(len(READERS)))
    assert (found.samples["idle"] == (1 << len(HALVES)) - 1).all()
    strays = found.samples["stray"]
    assert (strays[strays != 0] == (1 | client << 1)).all() and (strays != 0).sum() == len(client)


@pytest.mark.parametrize("more", [0, 7])
def test_surplus_responses(more):
    """One response per burst settles a writer; surplus ones and unknown IDs are strays."""
    bursts, asked = 3, len(WRITERS)
    client = np.concatenate([
        np.tile(np.arange(asked), bursts), np.arange(more) % asked, np.arange(asked, 1 << ID_BITS),
    ])  # fmt: skip
    first = 2 * bursts * asked + 10
    bid = np.append(np.zeros(first), client).astype(np.uint64)
    bvalid = np.repeat([0, 1, 0], [first, len(client), 1]).astype(np.uint64)
    found = run(writes=bursts, awready=1, wready=1, bvalid=bvalid, bid=bid).samples
    settled = found["settled"]
    assert (settled[-1] == (1 << asked) - 1) and (settled[first] == 0)
    assert found["idle"][-1] == (1 << len(HALVES)) - 1
    strays = found["stray"]
    right = 1 | client[bursts * asked :] << 1 | 1 << ID_BITS + 1
    assert (strays[strays != 0] == right).all() and (strays != 0).sum() == len(right)


def test_as_many_bursts_as_can_be_counted():
    most = (1 << OUTSTANDING_BITS) - 1
    result = run(reads=100, writes=most + 20, arready=1, awready=1, wready=1)
    assert result.samples["m_axi__arvalid"].sum() == 2 * most < 100 * len(READERS)
    assert result.samples["m_axi__awvalid"].sum() == len(WRITERS) * most < CYCLES


EARLY, OPENED, LATE = 20, 40, 80  # cycles: responses, the held channel opens, responses


def too_early(clients: int, held: str) -> tuple[np.ndarray, dict]:
    """Return the clients whose responses come too early, and the port's inputs.

    All clients get a response before their burst has left, and one after.
    held: the READY that is low until `OPENED`
    """
    ids, last = np.arange(clients), LATE + clients
    valid, client = np.zeros((2, last + 1), np.uint64)
    for first in (EARLY, LATE):
        valid[first : first + clients], client[first : first + clients] = 1, ids
    open_late = np.append(np.zeros(OPENED, np.uint64), np.uint64(1))
    ready = {name: open_late if name == held else 1 for name in ("arready", "awready", "wready")}
    return ids, ready | {"valid": valid, "id": client}


@pytest.mark.parametrize("held", ["awready", "wready"])
@pytest.mark.parametrize("beats", [1, 2, 5])
def test_responses_before_a_burst_has_left(held, beats):
    """Responses before a burst's address and last beat have left are strays; the burst is open."""
    ids, port = too_early(len(WRITERS), held)
    valid, client = port.pop("valid"), port.pop("id")
    found = run(writes=1, beats=beats, bvalid=valid, bid=client, **port).samples
    first = int(found["m_axi__awid"][np.flatnonzero(found["m_axi__awvalid"])[0]])
    assert not (found["settled"][10:OPENED] >> first & 1).any()
    assert found["settled"][-1] == (1 << len(ids)) - 1 and found["idle"][-1] == 0b11
    strays = found["stray"]
    assert (strays[strays != 0] == (1 | ids << 1 | 1 << ID_BITS + 1)).all()
    assert np.flatnonzero(strays).max() < LATE


def test_beats_before_a_burst_is_requested():
    ids, port = too_early(len(READERS), "arready")
    valid, client = port.pop("valid"), port.pop("id")
    result = run(reads=1, rvalid=valid, rid=client, rlast=1, **port)
    found = result.samples
    assert not (found["idle"][10:OPENED] & 1).any() and found["idle"][-1] == 0b11
    strays = found["stray"]
    assert (strays[strays != 0] == (1 | ids << 1)).all() and np.flatnonzero(strays).max() < LATE
    assert all(len(result.outputs[f"data__{k}"]) == 1 for k in ids)
