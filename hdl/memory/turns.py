"""A round-robin arbiter, and the choice that it makes among values."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


def selected(chosen: Value, values: list) -> Value:
    """The value whose bit is 1."""
    found = Const(0)
    for bit, value in zip(chosen, values, strict=True):
        value = Value.cast(value)
        found |= value & bit.replicate(len(value))
    return found


class Turns(wiring.Component):
    """A round-robin arbiter: chooses one of those that request.

    Members
        wants: a bit for each; favoured: those that come before all others. chosen: at most one of
            them. served: the chosen one has had its turn.

    **Timing**: combinational from `wants` to `chosen`.
    """

    def __init__(self, count: int):
        bits = dict.fromkeys(("wants", "favoured"), In(count))
        super().__init__(bits | {"chosen": Out(count), "served": In(1)})

    def elaborate(self, platform) -> Module:
        m = Module()
        count = len(self.wants)
        later = Signal(count)  # those whose turn comes before the others'
        favoured = self.wants & self.favoured
        wants = Mux(favoured.any(), favoured, self.wants)
        preferred = wants & later
        first = Mux(preferred.any(), preferred, wants)
        before = Cat(first[:k].any() for k in range(count))  # someone below comes first
        m.d.comb += self.chosen.eq(first & ~before)
        with m.If(self.served):
            m.d.sync += later.eq(before)
        return m
