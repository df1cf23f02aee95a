"""The memory port: order and throughput (`tb.formal.axi_master` proves the rest); patient
writers; bursts through a wide port: all beats arrive, each port beat is read once. Registers under
`cocotbext-axi`."""

from collections.abc import Iterable

import numpy as np
import pytest
from amaranth.hdl import Cat, Module, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import passes
from splatcore.hdl.memory.axi import CROWD, OUTSTANDING_BITS, Axi
from splatcore.hdl.memory.words import BURSTS_WAITING, Words
from splatcore.hdl.registers import Registers
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.sim.rtl.streams import Result
from splatcore.spec.axi import (
    BEAT_ADDRESS_BITS,
    DATA_BITS,
    PREPROCESSING,
    READERS,
    RENDERING,
    WRITERS,
    read_record,
    write_record,
)
from splatcore.spec.config import DEFAULT
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from tb.helpers.configs import PORTS, wide_addresses
from tb.helpers.memory_port import answer_reads
from tb.helpers.parts import forward
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


def run_port(reads: int = 0, writes: int = 0, beats: int = 1, patient: int = 0):
    """Run `reads` bursts per reader and `writes` per writer, of `beats` beats each, before a memory
    that takes all and answers nothing; samples of the port's wires by name."""
    rng = np.random.default_rng(0)

    def rows(record, count, **codes):
        fields = {"beat": rng.integers(0, 1 << 20, count), "length": np.full(count, beats - 1)}
        return record.pack(fields | codes)

    count = writes * beats
    data = {f"data{k}": rng.integers(0, 1 << 63, count) for k in range(DEFAULT.port // 64)}
    data["strobe"] = np.full(count, (1 << DEFAULT.port // 8) - 1)
    inputs = {f"reads__{k}": rows(read_record(), reads) for k in range(len(READERS))}
    record = write_record(DEFAULT)
    inputs |= {f"writes__{k}": rows(record, count, **data) for k in range(len(WRITERS))}
    constants = {f"m_axi__{name}": name.endswith("ready") for name in WIRES}
    constants |= {"failing": 0, "patient": patient}
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


def check_turns(clients: np.ndarray, among: Iterable[int]):
    """Check that clients are served in turns. among: their numbers, rising"""
    among = np.array(among)
    assert (np.sort(clients.reshape(-1, len(among)), axis=1) == among).all()


def test_a_read_every_cycle():
    found = run_port(reads=60)
    assert found["arvalid"].sum() == 60 * len(READERS) and gaps(found["arvalid"]) == 0
    check_turns(served(found, "ar"), range(len(READERS)))


@pytest.mark.parametrize("half", [PREPROCESSING, RENDERING])
def test_patient_writers_come_last(half):
    patient = list(WRITERS.values()).index(half)
    order = served(run_port(writes=40, patient=1 << patient), "aw")
    assert (np.bincount(order, minlength=len(WRITERS)) == 40).all()
    assert (order[-40:] == patient).all()
    check_turns(order[:-40], sorted({*range(len(WRITERS))} - {patient}))


def test_patient_writers_wait_for_reads():
    """They begin no burst while a half has `CROWD` reads in flight; other writers go on."""
    most = max(np.bincount(list(READERS.values())))
    patient = list(WRITERS.values()).index(RENDERING)
    for reads, begun in (((CROWD - 1) // most, 60), (-(-CROWD // most), 0)):
        order = served(run_port(reads=reads, writes=60, patient=1 << patient), "aw")
        count = np.bincount(order, minlength=len(WRITERS))
        assert (np.delete(count, patient) == 60).all() and count[patient] == begun


def test_a_memory_that_does_not_answer():
    """As many bursts as can be counted are in flight: of a half's readers, of each writer."""
    most = (1 << OUTSTANDING_BITS) - 1
    halves = np.array(list(READERS.values()))[served(run_port(reads=most + 5), "ar")]
    assert (np.bincount(halves) == most).all()
    order = served(run_port(writes=most + 5), "aw")
    assert (np.bincount(order, minlength=len(WRITERS)) == most).all()


@pytest.mark.parametrize("beats", [1, 2, 5])
def test_a_beat_written_every_cycle(beats):
    found = run_port(writes=40, beats=beats)
    valid, last = found["wvalid"], found["wlast"]
    assert valid.sum() == 40 * len(WRITERS) * beats and gaps(valid) == 0
    assert (np.flatnonzero(last[valid == 1]) % beats == beats - 1).all()
    assert (last & valid).sum() == found["awvalid"].sum() == 40 * len(WRITERS)
    check_turns(served(found, "aw"), range(len(WRITERS)))


LENGTH_MAX = 4  # beats per burst
IN_FLIGHT = 2 * BURSTS_WAITING  # bursts that memory accepts before it answers the first one

WORD = Record("word", {"address": Bits(BEAT_ADDRESS_BITS), "turn": Bits(32)})


class Memory(wiring.Component):
    """`Words` on a memory whose 16-byte beats hold their address and the number of the burst, of
    the port, that read them.

    bursts: the requests
    pace: one item per beat of the port
    pause: cycles from one burst to the next
    """

    def __init__(self):
        self.words = Words(PORTS[256], LENGTH_MAX)
        members = self.words.signature.members
        pace = In(stream.Signature(1))
        super().__init__(
            {"i": members["i"], "o": members["o"], "bursts": members["reads"], "pace": pace}
            | {"pause": In(8)}
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.words = words = self.words
        forward(m, self, words, ("o",))
        left, free = Signal(8), Signal()
        m.d.comb += [
            free.eq(left == 0),
            words.i.payload.eq(self.i.payload),
            words.i.valid.eq(self.i.valid & free),
            self.i.ready.eq(words.i.ready & free),
        ]
        with m.If(~free):
            m.d.sync += left.eq(left - 1)
        with m.Elif(self.i.valid & self.i.ready):
            m.d.sync += left.eq(self.pause)
        turn = Signal(32)

        def content(number: Value) -> Value:
            beat, word = Signal(BEAT_ADDRESS_BITS), Signal(DATA_BITS)
            m.d.comb += [beat.eq(number << 1), word.eq(Cat(beat, turn))]
            return Cat(word, word | 1)

        answer_reads(m, PORTS[256], words, self.bursts, self.pace, IN_FLIGHT, content)
        m.d.sync += turn.eq(turn + (passes(words.data) & words.data.payload.last))
        return m


def run_words(first: np.ndarray, count: np.ndarray, pause: int = 0, **options) -> Result:
    """Run bursts of beats, and check that all beats come in order."""
    words = np.concatenate([np.arange(b, b + n) for b, n in zip(first, count, strict=True)])
    codes = {"beat": first, "length": count - 1}
    inputs = {"i": read_record().pack(codes), "pace": np.zeros((2 * len(words), 1), np.uint8)}
    result = compiled(Memory).run(
        inputs, expected={"o": len(words)}, constants={"pause": pause}, **options
    )
    assert result.finished, result.stopped
    found = WORD.unpack(result.outputs["o"][:, : -(-WORD.width // 8)])
    np.testing.assert_array_equal(found["address"], words)
    return result


def asked(result: Result) -> np.ndarray:
    """Return the beats of the wide port that were read."""
    codes = read_record().unpack(result.outputs["bursts"])
    assert not (codes["beat"] % 2).any()
    pairs = zip(codes["beat"].astype(int) // 2, codes["length"].astype(int), strict=True)
    return np.concatenate([np.arange(b, b + n + 1) for b, n in pairs])


@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
def test_bursts(stall):
    """Adjacent bursts, bursts with gaps, repeated and backward ones; only needed beats are read."""
    rng = np.random.default_rng(int(10 * stall))
    count = rng.integers(1, LENGTH_MAX + 1, 600)
    gap = rng.choice([0, 0, 0, 1, 2, 5, -4, -1], 600)
    first = 1000 + np.cumsum(count + gap) - count
    result = run_words(first, count, stall=stall, seed=int(10 * stall))
    last = (first + count - 1) // 2
    whole = (last - first // 2 + 1).sum()
    shared = (gap[1:] == 0) & (first[1:] % 2 == 1)
    read = asked(result)
    assert whole - shared.sum() <= len(read) <= whole - 0.5 * shared.sum() < whole
    np.testing.assert_array_equal(np.unique(read), np.unique(np.concatenate(
        [np.arange(b // 2, e + 1) for b, e in zip(first, last, strict=True)]
    )))  # fmt: skip


@pytest.mark.parametrize("each", range(1, LENGTH_MAX + 1))
def test_neighbours(each):
    """Adjacent bursts read each port beat once, and deliver one 16-byte beat per cycle."""
    count = np.full(200, each)
    result = run_words(np.cumsum(count) - count, count)
    np.testing.assert_array_equal(asked(result), np.arange(-(-200 * each // 2)))
    assert result.cycles < 200 * each + 20


def test_nothing_is_kept():
    """A port beat that is needed again later is read again, as memory may have changed."""
    result = run_words(np.array([0, 1]), np.array([1, 1]), pause=40)
    assert asked(result).tolist() == [0, 0]
    turns = WORD.unpack(result.outputs["o"][:, : -(-WORD.width // 8)])["turn"]
    assert turns.tolist() == [0, 1]
