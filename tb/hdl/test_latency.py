"""Places of pipeline registers, and the depth of the logic between them."""

from itertools import product

import numpy as np
import pytest
from amaranth.hdl import Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.eda.gates.synth import DEPTH_MAX, depth
from splatcore.hdl.arithmetic.minmax import Clamp, Maximum
from splatcore.hdl.lib.latency import spread
from splatcore.hdl.stages import PRIMITIVES
from splatcore.spec.config import DEFAULT

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
