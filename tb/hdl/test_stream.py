"""Stream primitives: latency and throughput, and impossible sizes; `tb.formal.stream` proves
capacity and level. Design invariants: a violation stops a simulation, and none of them is in built
hardware."""

import gc

import numpy as np
import pytest
from amaranth.back import verilog
from amaranth.hdl import Module, ResetInserter
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.eda.gates.macros import Macros
from splatcore.hdl.binning import rows
from splatcore.hdl.lib.credit import within
from splatcore.hdl.lib.holds import BUILT, enough, holds, keeps, never_waits
from splatcore.hdl.lib.stream import MEMORY_DEPTH_MIN, Fork, Pipe, Queue
from splatcore.hdl.memory.fetch import Fetch
from splatcore.hdl.raster import raster
from splatcore.hdl.raster.features import Features
from splatcore.hdl.sorting.merge import Merge
from splatcore.hdl.sorting.sort import Sort
from splatcore.sim.rtl.streams import Simulation, SimulationError
from splatcore.spec.axi import BURST_BEATS
from splatcore.spec.config import TINY
from tb.helpers.runs import compiled
from tb.stages.primitives import ITEMS, LATENCIES, Primitives, items, outputs

VALID = {name: f"{outputs(name)[0]}__valid" for name in LATENCIES}


@pytest.mark.slow
def test_latency_and_pace():
    """Without stalls an item comes out in every cycle, of a slot in every other one."""
    part = compiled(Primitives, samples=tuple(VALID.values()))
    samples = items().check(part).samples
    offers = {name: np.flatnonzero(samples[valid]) for name, valid in VALID.items()}
    for name, latency in LATENCIES.items():
        steps = np.arange(ITEMS) * (2 if name == "slot" else 1)
        np.testing.assert_array_equal(offers[name], offers["fork"][0] + latency + steps, name)


@pytest.mark.slow
def test_a_wrong_bit_is_named():
    case = items()
    case.expected["queue_5__o"] = case.expected["queue_5__o"].copy()
    case.expected["queue_5__o"][ITEMS // 2, 0] ^= 1
    part = compiled(Primitives, samples=tuple(VALID.values()))
    with pytest.raises(AssertionError, match=f"queue_5__o: 1 differ, first {ITEMS // 2}"):
        case.check(part)


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
@pytest.mark.parametrize(
    "make",
    [
        lambda: Queue(8, 1),
        lambda: Queue(8, MEMORY_DEPTH_MIN - 1, memory=True),
        lambda: Fork(8, 0),
        lambda: Pipe(0),
    ],
)
def test_impossible_sizes(make):
    with pytest.raises(ValueError, match="below"):
        make()
    gc.collect()  # or Amaranth warns of the unused component during some other test


COUNT_MAX = 3


class Relying(wiring.Component):
    """Asserts that `odd` is 0, that offers at `i` are taken at once, that a count of `up` and
    `down` stays within 0 … `COUNT_MAX`, and that the offer of `given` is kept.

    clear: resets the counter
    """

    def __init__(self):
        bits = stream.Signature(1)
        inputs = dict.fromkeys(("odd", "up", "down", "clear", "ready"), In(1))
        self.offer = stream.Signature(2).create()
        inputs |= {"offered": In(1), "given": In(2), "taken": In(1)}
        super().__init__({"i": In(bits), "o": Out(bits), **inputs})

    def elaborate(self, platform) -> Module:
        m, inner = Module(), Module()
        m.submodules.inner = ResetInserter(self.clear)(inner)
        m.d.comb += [self.offer.valid.eq(self.offered), self.offer.payload.eq(self.given)]
        m.d.comb += self.offer.ready.eq(self.taken)
        m.d.comb += [self.i.ready.eq(self.ready), self.o.valid.eq(self.i.valid & self.ready)]
        holds(inner, "odd", ~self.odd, "something odd")
        never_waits(inner, "input", self.i, "an item at i")
        keeps(inner, "offer", self.offer)
        within(inner, "count", self.up, self.down, COUNT_MAX, "ups and downs", begin=1)
        return m


def relying(count: int = 0, **inputs: list[int]):
    """Run with `count` items at the input."""
    names = ("odd", "up", "down", "clear", "offered", "given", "taken")
    given = dict.fromkeys(names, 0) | {"ready": 1} | inputs
    constants = {k: np.array(np.atleast_1d(v), np.uint64) for k, v in given.items()}
    compiled(Relying).run({"i": np.zeros((count, 1), np.uint8)}, constants=constants, idle_max=30)


@pytest.mark.parametrize(
    "inputs",
    [
        {"count": 4},
        {"ready": [0, 0, 1], "count": 0},
        {"up": [1, 1, 0]},
        {"up": [1, 1, 1, 0], "down": [0, 0, 1, 0]},
        {"up": [1, 1, 0, 1, 1, 0], "clear": [0, 0, 1, 0]},
        {"down": [1, 0]},
        {"offered": [1, 1, 1, 0], "given": [2, 2, 3, 0], "taken": [0, 1, 1, 0]},
        {"down": [1, 1, 0], "up": [0, 1, 0]},
    ],
)
def test_invariants_that_hold_stop_nothing(inputs):
    relying(**inputs)


@pytest.mark.parametrize(
    "inputs, message",
    [
        ({"odd": [0, 0, 1, 0]}, "something odd"),
        ({"count": 2, "ready": [0] * 8 + [1]}, "no room for an item at i"),
        ({"up": [1, 0, 1, 0, 1, 0]}, "ups and downs"),
        ({"down": [1, 0, 1, 0]}, "ups and downs"),
        ({"offered": [1, 0], "taken": [0, 0]}, "not kept, offer"),
        ({"offered": [1, 1, 1], "given": [2, 3, 3]}, "not kept, offer"),
    ],
)
def test_violations_stop_a_simulation(inputs, message):
    with pytest.raises(SimulationError, match=message):
        relying(**inputs)


def test_invariants_are_not_built():
    simulated = verilog.convert(Relying(), name="top")
    assert simulated.count("assert (") == 4 and "something odd" in simulated
    for platform in (BUILT, Macros()):
        built = verilog.convert(Relying(), name="top", platform=platform)
        assert "assert" not in built and "odd" not in built.replace("odd;", "").replace("odd,", "")


@pytest.mark.slow
@pytest.mark.parametrize("make, message", [(Fetch, "not requested"), (Features, "asked for")])
def test_unrequested_beats_stop_a_simulation(make, message):
    """Inputs that are always ready have room for requested beats only."""
    simulation = Simulation(make(TINY, 16, 8) if make is Fetch else make(TINY))
    sources = simulation.ports.sources.items()
    beats = np.zeros((100, TINY.port // 8 + 1), np.uint8)
    beats[:, -1] = 1  # the last of its burst
    inputs = {name: np.zeros((0, -(-bits // 8)), np.uint8) for name, bits in sources}
    constants = dict.fromkeys(simulation.ports.driven, 0)
    with pytest.raises(SimulationError, match=message):
        simulation.run(inputs | {"data": beats}, constants=constants, stall=0.0)


@pytest.mark.parametrize(
    "module, name, least, make",
    [
        (rows, "OUTLINES", 5, lambda: rows.Rows(TINY)),
        (raster, "GROUPS_APART", 53, lambda: raster.Raster(TINY)),
        (Merge, "INTERVAL", 2, lambda: Sort(TINY)),
    ],
)
def test_depths_follow_from_latencies(monkeypatch, module, name, least, make):
    """A depth of one less than needed is refused at elaboration."""
    assert getattr(module, name) >= least
    monkeypatch.setattr(module, name, least)
    make()
    monkeypatch.setattr(module, name, least - 1)
    with pytest.raises(ValueError, match="are needed"):
        make()


def test_enough():
    enough(3, 3, "rows")
    with pytest.raises(ValueError, match="rows: 2, 3 are needed"):
        enough(2, 3, "rows")


def test_depth_below_a_burst():
    with pytest.raises(ValueError, match="below a burst"):
        Fetch(TINY, BURST_BEATS - 1, 8)
