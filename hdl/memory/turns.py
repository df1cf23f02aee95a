"""A round-robin arbiter, and a one-hot multiplexer."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out


def selected(chosen: Value, values: list) -> Value:
    """The value whose bit in `chosen` is 1; 0 if there is none."""
    found = Const(0)
    for bit, value in zip(chosen, values, strict=True):
        value = Value.cast(value)
        found |= value & bit.replicate(len(value))
    return found


class Turns(wiring.Component):
    """A round-robin arbiter.

    **Timing**: combinational from `wants` to `chosen`.
    """

    def __init__(self, count: int):
        ports = {
            "wants": In(count),  # one bit per client: it requests
            "chosen": Out(count),  # one-hot, the chosen client; 0 without requests
            "served": In(1),  # the chosen client has had its turn
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        count = len(self.wants)
        later = Signal(count)  # clients whose turn comes first
        preferred = self.wants & later
        first = Mux(preferred.any(), preferred, self.wants)
        before = Cat(first[:k].any() for k in range(count))  # a client below comes first
        m.d.comb += self.chosen.eq(first & ~before)
        with m.If(self.served):
            m.d.sync += later.eq(before)
        return m
