"""Bursts of 16-byte beats through a port of 32-byte beats: all arrive, each port beat read once."""

import numpy as np
import pytest
from amaranth.hdl import Cat, Module, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import passes
from splatcore.hdl.memory.words import BURSTS_WAITING, Words
from splatcore.sim.rtl.streams import Result
from splatcore.spec.axi import BEAT_ADDRESS_BITS, DATA_BITS, read_record
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from tb.helpers.configs import PORTS
from tb.helpers.memory_port import answer_reads
from tb.helpers.parts import forward
from tb.helpers.runs import compiled

LENGTH_MAX = 4  # beats per burst
IN_FLIGHT = 2 * BURSTS_WAITING  # bursts that memory accepts before it answers the first one

WORD = Record("word", {"address": Bits(BEAT_ADDRESS_BITS), "turn": Bits(32)})

pytestmark = pytest.mark.slow


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


def run(first: np.ndarray, count: np.ndarray, pause: int = 0, **options) -> Result:
    """Run bursts of beats, and check that all beats come in order."""
    words = np.concatenate([np.arange(b, b + n) for b, n in zip(first, count, strict=True)])
    codes = {"beat": first, "length": count - 1, "narrow": np.zeros_like(first)}
    inputs = {"i": read_record().pack(codes), "pace": np.zeros((2 * len(words), 1), np.uint8)}
    result = compiled(Memory).run(
        inputs, expected={"o": len(words)}, constants={"pause": pause}, **options
    )
    assert result.finished, result.stopped
    found = WORD.unpack(result.outputs["o"][:, : -(-WORD.width // 8)])
    np.testing.assert_array_equal(found["address"], words)
    return result


def asked(result: Result) -> np.ndarray:
    """Return the port's beats that were read."""
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
    result = run(first, count, stall=stall, seed=int(10 * stall))
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
    result = run(np.cumsum(count) - count, count)
    np.testing.assert_array_equal(asked(result), np.arange(-(-200 * each // 2)))
    assert result.cycles < 200 * each + 20


def test_nothing_is_kept():
    """A port beat that is needed again later is read again, as memory may have changed."""
    result = run(np.array([0, 1]), np.array([1, 1]), pause=40)
    assert asked(result).tolist() == [0, 0]
    turns = WORD.unpack(result.outputs["o"][:, : -(-WORD.width // 8)])["turn"]
    assert turns.tolist() == [0, 1]
