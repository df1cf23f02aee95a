"""Reading ranges of memory: the bursts, the beats, and room for all beats in flight."""

from functools import partial

import numpy as np
import pytest
from amaranth.hdl import Assert, Cat, Module, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In

from splatcore.hdl.memory.fetch import Fetch
from splatcore.spec.axi import (
    BEAT_ADDRESS_BITS,
    BURST_BEATS,
    port_beats,
    range_record,
    read_record,
)
from splatcore.spec.config import DEFAULT, Config
from tb.helpers.configs import PORTS
from tb.helpers.memory_port import answer_reads
from tb.helpers.parts import forward
from tb.helpers.runs import compiled

COUNT_BITS = 10
RANGE = range_record(COUNT_BITS)
IN_FLIGHT = 8  # bursts that the memory accepts before it answers the first one

pytestmark = pytest.mark.slow


class Memory(wiring.Component):
    """`Fetch` on a memory whose beats, of the port's width, hold their number and its complement.

    pace: one item per beat returned
    bursts: the requests; their `narrow` is the range's mark, set if its count is odd
    """

    def __init__(self, config: Config, depth: int, burst: int):
        self.config = config
        self.fetch = Fetch(config, depth, COUNT_BITS, burst, marks=True)
        fetch = self.fetch.signature.members
        pace = In(stream.Signature(1))
        super().__init__({"i": fetch["i"], "bursts": fetch["reads"], "pace": pace, "o": fetch["o"]})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.fetch = fetch = self.fetch
        forward(m, self, fetch, ("i", "o"))

        def content(number: Value) -> Value:
            beat = Signal(BEAT_ADDRESS_BITS)
            m.d.comb += beat.eq(number)
            return Cat(beat, ~beat)

        answer_reads(m, self.config, fetch, self.bursts, self.pace, IN_FLIGHT, content)
        m.d.comb += [
            self.bursts.payload.narrow.eq(fetch.reads.payload.narrow | fetch.marked),
            fetch.marks.eq(self.i.payload.count[0]),
            Assert(fetch.data.ready & (fetch.queue.i.ready | ~fetch.data.valid)),
        ]
        return m


def expected(first: np.ndarray, count: np.ndarray, burst: int, marks) -> tuple[list, np.ndarray]:
    """Return bursts (first beat, beats, mark) and beats of ranges, in beats of the port."""
    bursts = []
    for begin, end, mark in zip(first, first + count, marks, strict=True):
        starts = np.arange(begin // burst, -(-end // burst)) * burst
        bursts += [
            (max(begin, start), min(end, start + burst) - max(begin, start), mark)
            for start in starts
        ]
    return bursts, np.concatenate([np.arange(b, b + n) for b, n, _ in bursts])


def check(
    depth: int, first, count, stall: float = 0, seed: int = 0, burst=BURST_BEATS, config=DEFAULT
) -> int:
    """Check the requests and the beats of ranges; returns the cycles taken."""
    wide = port_beats(config)
    bursts, beats = expected(first // wide, -(-count // wide), burst // wide, count % 2)
    result = compiled(Memory, config, depth, burst).run(
        {"i": RANGE.pack({"beat": first, "count": count}), "pace": np.zeros((len(beats), 1), "u1")},
        expected={"bursts": len(bursts), "o": len(beats)}, stall=stall, seed=seed,
    )  # fmt: skip
    assert result.finished, result.stopped
    asked = read_record().unpack(result.outputs["bursts"])
    found = asked["beat"] // wide, asked["length"] + 1, asked["narrow"]
    assert [*zip(*found, strict=True)] == bursts
    assert not (asked["beat"] % wide).any()
    words = [int.from_bytes(row.tobytes(), "little") for row in result.outputs["o"]]
    mask = (1 << BEAT_ADDRESS_BITS) - 1
    assert words == [beat | (beat ^ mask) << BEAT_ADDRESS_BITS for beat in beats.tolist()]
    assert result.outputs["o"].shape[1] * 8 == config.port
    return result.cycles


@pytest.mark.parametrize("config", PORTS.values(), ids=PORTS)
@pytest.mark.parametrize(("depth", "burst"), [(BURST_BEATS, BURST_BEATS), (40, 16), (30, 4)])
def test_ranges(depth, burst, config):
    wide = port_beats(config)
    rng = np.random.default_rng(depth)
    for seed, stall in enumerate((0, 0.3, 0.7)):
        count = np.where(rng.random(120) < 0.3, rng.integers(1, 90, 120), rng.integers(1, 5, 120))
        first = rng.integers(0, 1 << 20, 120) * wide
        first[-1] = (1 << BEAT_ADDRESS_BITS) - -(-count[-1] // wide) * wide  # the end of memory
        check(depth, first, count, stall, seed, burst, config)


@pytest.mark.parametrize("config", PORTS.values(), ids=PORTS)
def test_pace(config):
    slack, wide = 24, port_beats(config)
    pace = partial(check, 40, config=config)
    assert pace(np.array([6]), np.array([1000])) < 1000 / wide + slack
    first = np.arange(300) * 100
    assert pace(first, np.full(300, 1)) < 2 * 300 + slack  # a burst every 2 cycles
    assert pace(first, np.full(300, 4 * wide)) < 4 * 300 + slack


def test_depth_below_a_burst():
    with pytest.raises(ValueError, match="below a burst"):
        Fetch(DEFAULT, BURST_BEATS - 1, COUNT_BITS)
