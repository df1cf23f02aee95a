"""Parts of `hdl.lib`: layouts of records, places of pipeline registers, counters, functions."""

from collections.abc import Callable
from functools import partial
from itertools import product

import numpy as np
import pytest
from amaranth.hdl import Const, Module, Signal, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from amaranth.sim import Simulator
from hypothesis import given, settings
from hypothesis import strategies as st

from splatcore.eda.gates.synth import DEPTH_MAX, depth
from splatcore.hdl.arithmetic.minmax import Clamp, Maximum
from splatcore.hdl.lib.counters import SPARE, Counters
from splatcore.hdl.lib.latency import spread
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.shift import plus_one, several
from splatcore.hdl.stages import PRIMITIVES
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import DEFAULT
from splatcore.spec.number import FP24, Bits, Fixed
from splatcore.spec.record import Array, Record
from tb.helpers.formats import FORMATS, random_codes, records


def check_every_value(width: int, function: Callable, expected: Callable):
    """Compare a combinational function of a signal with one of its value, for every value."""
    m = Module()
    value = Signal(width)
    given = function(value)
    found = Signal(len(given))
    m.d.comb += found.eq(given)

    async def every_value(context):
        for number in range(1 << width):
            context.set(value, number)
            assert context.get(found) == expected(number)

    simulator = Simulator(m)
    simulator.add_testbench(every_value)
    simulator.run()


@pytest.mark.parametrize("logic", ["gates", "fpga"])
@pytest.mark.parametrize("width", [1, 2, 7])
def test_plus_one(width, logic):
    """Also of the value that wraps."""
    check_every_value(width, partial(plus_one, logic=logic), lambda n: (n + 1) % (1 << width))


@pytest.mark.parametrize("width", [1, 2, 5])
def test_several(width):
    check_every_value(width, several, lambda n: n.bit_count() > 1)


BITS = 12  # few, so that the end is reached


def counts(event: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """Return the values of both counters in every cycle, [cycles, 2]."""
    run = Simulation(Counters(("one", "other"), BITS), samples=("value",)).run(
        {}, constants={"event": event, "clear": clear}, cycles_max=len(event) + 8
    )
    value = run.samples["value"].astype(np.int64)
    return np.stack([value & ((1 << BITS) - 1), value >> BITS], axis=1)


@pytest.mark.slow
def test_every_event_is_counted_once():
    rng = np.random.default_rng(1)
    cycles = (1 << BITS) - 200
    event = rng.integers(0, 4, cycles).astype(np.uint64)
    event[-1] = 0  # inputs keep their last value
    found = counts(event, np.zeros(cycles, np.uint64))
    for bit in range(2):
        assert found[-1, bit] == int((event >> np.uint64(bit) & np.uint64(1)).sum())
        steps = np.diff(found[:, bit])
        assert steps.min() == 0 and steps.max() == 1  # no cycle shows a count without its carry


@pytest.mark.slow
def test_counters_end():
    cycles = (1 << BITS) + 500
    found = counts(np.full(cycles, 3, np.uint64), np.zeros(cycles, np.uint64))
    assert (np.diff(found, axis=0) >= 0).all()
    assert (1 << BITS) - (1 << SPARE) <= found[-1].min() <= found[-1].max() < 1 << BITS


@pytest.mark.slow
def test_counters_clear():
    event, clear = np.full(40, 3, np.uint64), np.zeros(40, np.uint64)
    event[20:], clear[20] = 0, 1
    found = counts(event, clear)
    assert found[19].min() > 10 and found[22:].max() == 0


CUTS = {"operand": 12, "product": 36, "order": 27, "sum": 30, "shift": 20, "round": 13}


def test_spread():
    """The given number of registers, one at the end, such that the longest stretch is shortest."""
    depths = np.array(list(CUTS.values()))
    assert spread(0, CUTS) == dict.fromkeys(CUTS, 0)
    assert spread(1, CUTS) == dict.fromkeys(CUTS, 0) | {"round": 1}
    for latency in range(1, len(CUTS) + 1):
        registers = spread(latency, CUTS)
        assert list(registers) == list(CUTS) and sum(registers.values()) == latency

        longest = {}
        for inner in product((0, 1), repeat=len(CUTS) - 1):
            if sum(inner) == latency - 1:
                stretch = np.append(0, np.cumsum(inner))  # of each cut's logic
                longest[*inner, 1] = np.bincount(stretch, depths).max()
        assert longest[tuple(registers.values())] == min(longest.values())


def test_spread_evens_out():
    """With equal longest stretches, the placement with the shorter second longest is chosen."""
    assert spread(3, {"a": 40, "b": 1, "c": 20, "d": 20}) == {"a": 1, "b": 0, "c": 1, "d": 1}


def test_spread_beyond_the_cuts():
    """Every cut has a register, and the deepest logic has several."""
    assert spread(7, CUTS) == dict.fromkeys(CUTS, 1) | {"product": 2}
    assert spread(9, CUTS) == dict.fromkeys(CUTS, 1) | {"product": 2, "order": 2, "sum": 2}
    assert sum(spread(30, CUTS).values()) == 30


def test_negative_latency():
    with pytest.raises(ValueError, match="negative"):
        spread(-1, CUTS)


class Multiplexed(wiring.Component):
    """A unit as in an array: operands come from `SOURCES`-way multiplexers; it never stalls."""

    SOURCES = 11

    def __init__(self, unit: wiring.Component):
        self.unit = unit
        self.operands = [name for name in ("a", "b", "c") if hasattr(unit, name)]
        inputs = {name: In(self.SOURCES * len(getattr(unit, name))) for name in self.operands}
        super().__init__(inputs | {"choice": In(range(self.SOURCES)), "o": Out(len(unit.o))})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.unit = unit = self.unit
        choice = Signal.like(self.choice)
        m.d.sync += choice.eq(self.choice)
        m.d.comb += [unit.enable.eq(1), self.o.eq(unit.o)]
        for name in self.operands:
            operand = getattr(unit, name)
            m.d.comb += operand.eq(getattr(self, name).word_select(choice, len(operand)))
        return m


UNITS = {
    **{name: PRIMITIVES[name] for name in ("multiply_add", "reciprocal", "rsqrt")},
    "clamp": lambda config: Clamp(config.arithmetic),
    "maximum": lambda config: Maximum(config.arithmetic),
}


@pytest.mark.slow
@pytest.mark.parametrize("unit", UNITS)
def test_depth(unit):
    """Alone, with the logic of `enable`; and behind multiplexers."""
    for component in (UNITS[unit](DEFAULT), Multiplexed(UNITS[unit](DEFAULT))):
        assert depth(component) <= DEPTH_MAX


repeatable = settings(deadline=None, derandomize=True, database=None)


def assert_same_layout(shape, format):
    """Check that a shape has the format's widths and offsets, at every level."""
    if isinstance(format, Record):
        assert isinstance(shape, data.StructLayout)
        assert shape.size == format.width
        assert {name: field.offset for name, field in shape} == format.offsets
        for name, field in shape:
            assert_same_layout(field.shape, format[name])
    elif isinstance(format, Array):
        assert isinstance(shape, data.ArrayLayout)
        assert (shape.size, shape.length) == (format.width, format.length)
        assert_same_layout(shape.elem_shape, format.format)
    else:
        assert shape == unsigned(format.width)


def value(constant, format, codes, index: tuple[int, ...]) -> bool:
    """Return whether a constant of the layout holds the codes of record `index`."""
    if isinstance(format, Record):
        fields = format.fields
        return all(value(constant[name], inner, codes[name], index) for name, inner in fields)
    if isinstance(format, Array):
        inner, length = format.format, format.length
        return all(value(constant[k], inner, codes, (*index, k)) for k in range(length))
    return constant == int(codes[index])


@given(record=records(FORMATS))
@repeatable
def test_widths_and_offsets(record):
    assert_same_layout(layout(record), record)


@given(record=records(FORMATS), count=st.integers(1, 3), seed=st.integers(0, 1000))
@repeatable
def test_payloads(record, count, seed):
    """A packed payload, read through the layout, gives each code."""
    given = random_codes(record, (count,), np.random.default_rng(seed))
    for k, packed in enumerate(record.pack(given)):
        payload = int.from_bytes(packed.tobytes(), "little")
        assert value(layout(record).from_bits(payload), record, given, (k,))


def test_example():
    point = Record("point", {"x": Fixed(4, 3, signed=True), "y": Bits(2)})
    pair = Record("pair", {"depth": FP24, "points": Array(point, 2)})
    shape = layout(pair)
    assert shape.size == 24 + 2 * (8 + 2)
    assert [shape["depth"].offset, shape["points"].offset] == [0, 24]
    constant = Const({"depth": 0xABCDEF, "points": [{"x": 0x81, "y": 1}, {"x": 2, "y": 3}]}, shape)
    assert constant.as_value().value == 0xABCDEF | 0x81 << 24 | 1 << 32 | 2 << 34 | 3 << 42
