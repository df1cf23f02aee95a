"""Performance counters."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

COUNTER_BITS = 32


class Counters(wiring.Component):
    """Counts events, each in a register of its own that stays at its largest value.

    Members
        event: a bit for each name; high for a cycle: one more.
        clear: all are 0 in the next cycle.
        value: the counts.

    **Timing**: a count is seen two cycles after its event, which is registered first: events come
    late in their cycle.
    """

    def __init__(self, names: tuple[str, ...]):
        self.names = names
        super().__init__(
            {
                "event": In(data.StructLayout(dict.fromkeys(names, 1))),
                "clear": In(1),
                "value": Out(data.StructLayout(dict.fromkeys(names, COUNTER_BITS))),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        event = Signal.like(self.event)
        m.d.sync += event.eq(Mux(self.clear, 0, self.event))
        for name in self.names:
            with m.If(event[name] & ~self.value[name].all()):
                m.d.sync += self.value[name].eq(self.value[name] + 1)
        with m.If(self.clear):
            m.d.sync += self.value.eq(0)
        return m
