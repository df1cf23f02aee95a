"""`plus_one` and `several` of `hdl.lib.shift`, for every value."""

import pytest
from amaranth.hdl import Module, Signal
from amaranth.sim import Simulator

from splatcore.hdl.lib.shift import plus_one, several


@pytest.mark.parametrize("logic", ["gates", "fpga"])
@pytest.mark.parametrize("width", [1, 2, 7])
def test_plus_one(width, logic):
    """Every value, including the one that wraps."""
    m = Module()
    value, more = Signal(width), Signal(width)
    m.d.comb += more.eq(plus_one(value, logic))

    async def counting(context):
        for number in range(1 << width):
            context.set(value, number)
            assert context.get(more) == (number + 1) % (1 << width)

    simulator = Simulator(m)
    simulator.add_testbench(counting)
    simulator.run()


@pytest.mark.parametrize("width", [1, 2, 5])
def test_several(width):
    m = Module()
    value, found = Signal(width), Signal()
    m.d.comb += found.eq(several(value))

    async def every_value(context):
        for number in range(1 << width):
            context.set(value, number)
            assert context.get(found) == (number.bit_count() > 1)

    simulator = Simulator(m)
    simulator.add_testbench(every_value)
    simulator.run()
