"""`sim.rtl.streams`: all rows pass in order under all stalls; faults are found and named."""

import numpy as np
import pytest
from amaranth.hdl import Assert, Cat, Module, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.stream import Fork, Queue, Register
from splatcore.sim.rtl.streams import TAIL, Simulation, SimulationError, StreamRuleError
from splatcore.spec.number import Bits
from splatcore.spec.record import Record
from tb.helpers.parts import SideBySide

pytestmark = pytest.mark.slow

COUNT = 300
STALLS = (0.0, 0.3, 0.6, 0.9)
BITS = 5
LOST = 100  # number of the item at which a faulty component fails


class Faulty(wiring.Component):
    """A wire from `i` to `o` with one fault; `noise` sums the payloads that are not valid.

    lost: item `LOST` is dropped
    twice: item `LOST` is emitted twice
    stuck: item `LOST` is never accepted
    falls: valid is not held after a cycle without ready
    changes: the payload is not held after a cycle without ready
    asserts: an assertion fails at item `LOST`
    """

    def __init__(self, fault: str):
        super().__init__(
            {"i": In(stream.Signature(BITS)), "o": Out(stream.Signature(BITS)), "noise": Out(32)}
        )
        self.fault = fault

    def elaborate(self, platform) -> Module:
        m = Module()
        count, again, waited = Signal(16), Signal(), Signal()
        m.d.comb += [
            self.o.valid.eq(self.i.valid),
            self.o.payload.eq(self.i.payload),
            self.i.ready.eq(self.o.ready),
        ]
        m.d.sync += waited.eq(self.o.valid & ~self.o.ready)
        here = self.i.valid & (count == LOST)
        if self.fault == "lost":
            with m.If(here):
                m.d.comb += [self.o.valid.eq(0), self.i.ready.eq(1)]
        elif self.fault == "twice":
            with m.If(here & ~again):
                m.d.comb += self.i.ready.eq(0)
                m.d.sync += again.eq(self.o.ready)
        elif self.fault == "stuck":
            with m.If(here):
                m.d.comb += [self.o.valid.eq(0), self.i.ready.eq(0)]
        elif self.fault == "falls":
            m.d.comb += self.o.valid.eq(self.i.valid & ~waited)
        elif self.fault == "changes":
            m.d.comb += self.o.payload.eq(self.i.payload ^ waited)
        elif self.fault == "asserts":
            m.d.comb += Assert(~here, "item came")
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += count.eq(count + 1)
        with m.If(~self.i.valid):
            m.d.sync += self.noise.eq(self.noise + self.i.payload)
        return m


class Join(wiring.Component):
    """`o` is an item of `a` and an item of `b`, concatenated, xor `key`; purely combinational."""

    def __init__(self):
        inputs = {"a": In(stream.Signature(8)), "b": In(stream.Signature(92))}
        inputs |= {"key": In(100), "mask": In(8)}
        outputs = {"o": Out(stream.Signature(100)), "masked": Out(8), "keys": Out(100)}
        super().__init__(inputs | outputs)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.d.comb += [
            self.o.valid.eq(self.a.valid & self.b.valid),
            self.a.ready.eq(self.o.ready & self.b.valid),
            self.b.ready.eq(self.o.ready & self.a.valid),
            self.o.payload.eq(Cat(self.a.payload, self.b.payload) ^ self.key),
            self.masked.eq(self.a.payload & self.mask),
            self.keys.eq(self.key),
        ]
        return m


PARTS = {f"register_{width}": Register(width) for width in (1, 8, 16, 17, 33)}
PARTS |= {
    "queue_64": Queue(64, 5),
    "queue_65": Queue(65, 8, memory=True),
    "queue_300": Queue(300, 3),
    "fork": Fork(40, 3),
}
FAULTS = ("lost", "twice", "stuck", "falls", "changes", "asserts")


@pytest.fixture(scope="module")
def parts() -> Simulation:
    """One simulation that holds all components, unconnected."""
    parts = PARTS | {fault: Faulty(fault) for fault in FAULTS}
    return Simulation(SideBySide(parts), samples=("queue_64__level", "queue_64__i__ready"))


@pytest.fixture(scope="module")
def join() -> Simulation:
    return Simulation(Join(), samples=("masked", "keys"))


def random_rows(width: int, count: int, seed: int = 0) -> np.ndarray:
    size = -(-width // 8)
    rows = np.random.default_rng(seed).integers(0, 256, (count, size), np.uint8)
    rows[:, -1] >>= -width % 8
    return rows


def run(simulation: Simulation, inputs: dict, expected: dict | None = None, **options):
    """Run some of the components: the other in streams get no rows."""
    widths = simulation.ports.sources.items()
    silent = {name: np.zeros((0, -(-width // 8)), np.uint8) for name, width in widths}
    return simulation.run(silent | inputs, expected=expected, **options)


def run_fault(simulation: Simulation, fault: str, **options):
    rows = random_rows(BITS, COUNT)
    return run(simulation, {f"{fault}__i": rows}, {f"{fault}__o": COUNT}, **options), rows


@pytest.mark.parametrize("stall", STALLS)
def test_all_rows_pass_in_order(parts, stall):
    inputs, outputs = {}, {}
    for name in PARTS:
        rows = random_rows(parts.ports.sources[f"{name}__i"], COUNT, seed=len(name))
        inputs[f"{name}__i"] = rows
        outputs |= {sink: rows for sink in parts.ports.sinks if sink.startswith(f"{name}__")}
    assert len(outputs) == len(PARTS) + 2
    result = run(parts, inputs, dict.fromkeys(outputs, COUNT), stall=stall, seed=7)
    assert result.finished, result.stopped
    for name, rows in outputs.items():
        np.testing.assert_array_equal(result.outputs[name], rows, err_msg=name)
    assert result.taken | dict.fromkeys(inputs, COUNT) == result.taken
    assert result.ports["queue_64__level"] == 0
    assert result.cycles >= COUNT / (1 - stall)
    assert result.cycles <= COUNT + 4 or stall  # no queue here has a latency above 2


def test_queues_fill_and_idle(parts):
    """Stalls occur on both sides, so the queue is sometimes full and sometimes empty."""
    inputs = {"queue_64__i": random_rows(64, 5000)}
    result = run(parts, inputs, {"queue_64__o": 5000}, stall=0.5)
    level, ready = result.samples["queue_64__level"], result.samples["queue_64__i__ready"]
    assert result.finished and len(level) == len(ready) > result.cycles
    np.testing.assert_array_equal(level != 5, ready)
    assert set(level) == set(range(6))
    assert (level == 0).mean() > 0.1 and (level == 5).mean() > 0.1
    assert 2.0 < result.cycles / 5000 < 3.0


def test_a_seed_repeats_itself(parts):
    inputs = {"queue_64__i": random_rows(64, COUNT)}
    expected = {"queue_64__o": COUNT}
    runs = [run(parts, inputs, expected, stall=0.5, seed=seed) for seed in (1, 1, 2)]
    levels = [found.samples["queue_64__level"] for found in runs]
    np.testing.assert_array_equal(levels[0], levels[1])
    assert not np.array_equal(levels[0], levels[2])


@pytest.mark.parametrize("expected", [None, {}, {"queue_64__o": 0}])
def test_nothing_to_do(parts, expected):
    result = run(parts, {}, expected, idle_max=200)
    assert result.finished and result.cycles == 0
    assert not any(len(rows) for rows in result.outputs.values())


def test_without_expectations(parts):
    """Without expected counts a run ends once no stream moves."""
    rows = random_rows(300, COUNT)
    result = run(parts, {"queue_300__i": rows}, stall=0.3)
    assert result.finished and result.stopped.startswith("nothing moved for 20000 cycles")
    np.testing.assert_array_equal(result.outputs["queue_300__o"], rows)
    assert not run(parts, {"stuck__i": random_rows(BITS, COUNT)}).finished


def test_all_inputs_are_awaited(parts):
    """A run that expects no output still waits until all input rows are taken."""
    result = run(parts, {"queue_300__i": random_rows(300, COUNT)}, {"lost__o": 0}, stall=0.3)
    assert result.finished and result.taken["queue_300__i"] == COUNT
    assert len(result.outputs["queue_300__o"]) == COUNT


def test_streams_listed_as_first(parts):
    inputs = {"queue_64__i": random_rows(64, COUNT), "queue_300__i": random_rows(300, COUNT)}
    for first, second in (((), COUNT), (["queue_64__i"], 0)):
        result = run(parts, inputs, cycles_max=COUNT, first=first)
        assert [result.taken[name] for name in inputs] == [COUNT, second]


def test_noise_while_not_valid(parts):
    result, _ = run_fault(parts, "changes")
    noise, cycles = result.ports["changes__noise"], TAIL  # not valid in these cycles
    assert 0.25 < noise / cycles / (1 << BITS) < 0.75


@pytest.mark.parametrize("stall", STALLS)
def test_an_item_lost_twice_or_stuck(parts, stall):
    """A lost, doubled or stuck item is found; the extra row comes within the last 64 cycles."""
    result, rows = run_fault(parts, "lost", stall=stall)
    assert not result.finished
    assert f"lost__o gave {COUNT - 1} of {COUNT} rows" in result.stopped
    assert "nothing moved" in result.stopped
    np.testing.assert_array_equal(result.outputs["lost__o"], np.delete(rows, LOST, 0))
    result, rows = run_fault(parts, "twice", stall=stall)
    assert result.finished
    twice = np.insert(rows, LOST, rows[LOST], 0)
    np.testing.assert_array_equal(result.outputs["twice__o"], twice)
    result, _ = run_fault(parts, "stuck", stall=stall)
    assert not result.finished
    assert f"stuck__i took {LOST} of {COUNT}" in result.stopped


@pytest.mark.parametrize(
    "fault, message",
    [("falls", "falls__o: valid fell"), ("changes", "changes__o: the payload changed")],
)
@pytest.mark.parametrize("stall", STALLS)
def test_the_stream_rule(parts, fault, message, stall):
    if stall == 0:  # ready never waits, so nothing can be taken back
        assert run_fault(parts, fault)[0].finished
        return
    with pytest.raises(StreamRuleError, match=rf"{message}.* in cycle \d+") as raised:
        run_fault(parts, fault, stall=stall)
    assert len(raised.value.result.outputs[f"{fault}__o"]) < COUNT


def test_a_failed_assertion(parts):
    with pytest.raises(SimulationError, match="item came"):
        run_fault(parts, "asserts")


def test_the_limit(parts):
    result, _ = run_fault(parts, "lost", cycles_max=50)
    assert not result.finished and result.cycles == 50
    assert result.stopped.startswith("the limit of 50 cycles was reached: ")


@pytest.mark.parametrize("stall", STALLS)
def test_two_inputs_and_a_wide_constant(join, stall):
    """Two streams and a 100-bit constant, without a clock; `mask` has one value per cycle."""
    inputs = {"a": random_rows(8, COUNT, 1), "b": random_rows(92, COUNT, 2)}
    key, mask = (1 << 100) - 12345, np.arange(COUNT) % 256
    constants = {"key": key, "mask": mask}
    result = join.run(inputs, constants=constants, expected={"o": COUNT}, stall=stall)
    assert result.finished, result.stopped
    record = Record("joined", {"low": Bits(64), "high": Bits(36)})
    joined = np.concatenate([inputs["a"], inputs["b"]], axis=1)
    found, given = record.unpack(result.outputs["o"]), record.unpack(joined)
    np.testing.assert_array_equal(found["low"], given["low"] ^ np.uint64(key % (1 << 64)))
    np.testing.assert_array_equal(found["high"], given["high"] ^ np.uint64(key >> 64))
    assert result.ports["keys"] == key
    assert bytes(result.samples["keys"][5]) == key.to_bytes(13, "little")
    if stall == 0:
        masked = inputs["a"][:, 0] & mask
        np.testing.assert_array_equal(result.samples["masked"][:COUNT], masked)
        assert len(result.samples["masked"]) == COUNT + 64
    uneven = inputs | {"b": inputs["b"][:7]}
    result = join.run(uneven, constants={"key": -1, "mask": 0}, expected={"o": 7})
    assert result.finished and result.taken == {"a": 7, "b": 7}
    assert result.ports["keys"] == (1 << 100) - 1


def test_invalid_arguments(join):
    rows = {"a": random_rows(8, 2), "b": random_rows(92, 2)}
    constants = {"key": 0, "mask": 0}
    for wrong, message in (
        ({"inputs": {"a": rows["a"]}}, "inputs .* are not"),
        ({"inputs": {}}, "inputs .* are not"),
        ({"constants": {"key": 0}}, "constants .* are not"),
        ({"constants": constants | {"mask": 256}}, "mask: 256 does not fit in 8 bits"),
        ({"constants": constants | {"mask": np.array([1, 256])}}, "mask: a number does not fit"),
        ({"constants": constants | {"key": np.array([1, 2])}}, "key: .* 100 bits; pass rows"),
        ({"inputs": rows | {"b": rows["b"][:, 1:]}}, r"b: .* is not uint8 \[N, 12\]"),
        ({"inputs": rows | {"b": rows["b"] | 0x80}}, "b: a row has bits above its 92"),
        ({"expected": {"p": 1}}, "no out stream p"),
        ({"first": ["p"]}, "no in stream p"),
        ({"stall": 1.0}, "stall 1.0"),
    ):
        given = {"inputs": rows, "constants": constants} | wrong
        with pytest.raises(ValueError, match=message):
            join.run(given.pop("inputs"), **given)
    with pytest.raises(ValueError, match="no output level"):
        Simulation(Join(), samples=["level"])
