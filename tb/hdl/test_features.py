"""Reader of features: each splat's own, as it is now in memory; a beat is read once for both."""

import numpy as np
import pytest
from amaranth.hdl import Cat, Const, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Queue, passes
from splatcore.hdl.raster.features import KEPT, ROWS, Features
from splatcore.hdl.raster.recent import Recent
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.axi import DATA_BITS
from splatcore.spec.config import Config
from splatcore.spec.group import SPLAT_BITS, sorted_record
from tb.helpers.configs import PORTS
from tb.helpers.runs import compiled, faults_are_found
from tb.planted.fault import planted_in

GROUP_BITS = 8


class Read(wiring.Component):
    """The reader with a memory whose features are a splat's number and the number of the group.

    A group is offered when the one before has left, as memory changes only between frames.
    """

    def __init__(self, config: Config):
        self.config = config
        self.numbers = SPLAT_BITS + GROUP_BITS
        ports = {
            "i": In(stream_of(sorted_record(config))),
            "o": Out(stream.Signature(self.numbers + 1)),  # feature and end
            "answers": In(1),  # memory answers a request
            "count": Out(16),  # beats read
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = Features(self.config)
        m.submodules.asked = asked = Queue(SPLAT_BITS, 100)
        group, waits = Signal(GROUP_BITS), Signal()
        i, o, given = self.i, self.o, part.o
        halves = self.config.port // DATA_BITS
        below = exact_log2(halves)
        first = asked.o.payload[below:]
        numbers = [Cat(Const(half, below), first, group) for half in range(halves)]
        m.d.comb += [
            part.i.payload.eq(i.payload),
            part.i.valid.eq(i.valid & ~waits),
            i.ready.eq(part.i.ready & ~waits),
            part.live.eq(~0),
            asked.i.valid.eq(part.reads.valid),
            asked.i.payload.eq(part.reads.payload.beat),
            part.reads.ready.eq(asked.i.ready),
            part.data.valid.eq(asked.o.valid & self.answers),
            asked.o.ready.eq(self.answers),
            part.data.payload.beat.eq(
                Cat(Cat(number, Signal(DATA_BITS - self.numbers)) for number in numbers)
            ),
            part.data.payload.last.eq(1),
            o.valid.eq(given.valid),
            o.payload.eq(Cat(given.payload.splat.as_value()[: self.numbers], given.payload.end)),
            given.ready.eq(o.ready),
        ]
        m.d.sync += self.count.eq(self.count + passes(part.data))
        with m.If(passes(part.i) & i.payload.end):
            m.d.sync += waits.eq(1)
        with m.If(passes(o) & given.payload.end):
            m.d.sync += [waits.eq(0), group.eq(group + 1)]
        return m


def check(part: Simulation, config: Config, groups: list[np.ndarray], **options):
    """Check the features of groups of splats; the beats that were read."""
    ends = [np.append(np.zeros(len(one), int), 1) for one in groups]
    splats = [np.append(one, 0) for one in groups]
    end, splat = np.concatenate(ends), np.concatenate(splats)
    number = np.repeat(np.arange(len(groups)), [len(one) for one in ends])
    codes = {"splat": splat, "mask": np.full(len(end), (1 << config.group**2) - 1), "end": end}
    wanted = np.where(end == 1, 1 << SPLAT_BITS + GROUP_BITS, splat + (number << SPLAT_BITS))
    result = part.run(
        {"i": sorted_record(config).pack(codes)}, expected={"o": len(wanted)}, **options
    )
    assert result.finished, result.stopped
    rows = np.pad(result.outputs["o"], [(0, 0), (0, 3)]).view("<u8")[:, 0]
    np.testing.assert_array_equal(rows, wanted)
    return result.ports["count"]


def walk(rng: np.random.Generator, count: int, step: int) -> np.ndarray:
    """Splats with beats that come again after a few others, and after hundreds."""
    return (1 << 12) + np.cumsum(rng.integers(-step, step + 1, count)) % (1 << 12)


def check_all(part: Simulation, config: Config = PORTS[256]):
    """Check that fails with each fault."""
    rng = np.random.default_rng(0)
    answers = rng.random(20_000) < np.repeat(rng.choice([0.02, 0.3, 1], 200), 100)
    for seed, (step, stall) in enumerate([(2, 0), (6, 0.5), (30, 0), (200, 0.5)]):
        groups = [walk(rng, count, step) for count in (700, 3, 300, 1, 900)]
        groups += [groups[-1][-20:], groups[-1][-20:]]  # what was kept before memory changed
        pace = {"answers": np.append(answers, True).astype(np.uint64)}
        check(part, config, groups, constants=pace, stall=stall, seed=seed)
    if config.port > DATA_BITS:
        firsts = np.arange(0, KEPT, 2)
        again = np.concatenate([np.append(firsts, firsts + 1) + 200 * k for k in range(4)])
        assert check(part, config, [again], constants={"answers": 1}) == len(again) // 2
        # A row is looked up for its old beat in the cycle in which it is given to another.
        rows = 2 * np.append(np.arange(ROWS + KEPT), ROWS + KEPT + 40)
        check(part, config, [np.tile(rows, 3)], constants={"answers": 1})


@pytest.mark.parametrize("port", PORTS)
def test_equals_memory(port):
    check_all(compiled(Read, PORTS[port]), PORTS[port])


FAULTS = planted_in(
    Features,
    _ask={"a beat is not awaited": ("order.payload.new.eq(new)", "order.payload.new.eq(0)")},
    _give={"the other half": ("word_select(given.part", "word_select(~given.part")},
) | planted_in(
    Recent,
    _found={
        "a beat of the frame before": ("self.fresh.eq(0)", "self.fresh.eq(self.fresh)"),
        "any row that was looked up": ("(beat.data == beat_of) & ", ""),
        "a row given while it is read": ("~written & ", ""),
        "a row of any age": ("(behind < self.fresh)", "self.fresh.any()"),
        "nothing is found": ("old.eq(", "old.eq(0 & "),
    },
)

test_fault_is_found = faults_are_found(lambda: Read(PORTS[256]), FAULTS, check_all)
