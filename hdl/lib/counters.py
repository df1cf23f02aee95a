"""Performance counters of the stages."""

from collections.abc import Iterable, Mapping

from amaranth.hdl import Cat, Module, Signal, ValueLike
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.spec.counters import COUNTER_BITS

SPARE = 4
"""A counter stops within 2^SPARE of its maximum, so that events in flight can still be counted."""


def counters_layout(names: Iterable[str]) -> data.StructLayout:
    """Layout of counts by name."""
    return data.StructLayout(dict.fromkeys(names, COUNTER_BITS))


def count_events(m: Module, part: wiring.Component, events: Mapping[str, ValueLike]):
    """Add counters of `events` to a component with the members `clear` and `counters`."""
    m.submodules.counters = counters = Counters(tuple(part.counters.shape().members))
    m.d.comb += [counters.event[name].eq(event) for name, event in events.items()]
    m.d.comb += [counters.clear.eq(part.clear), part.counters.eq(counters.value)]


class Counters(wiring.Component):
    """Counts events, each in its own register, which stops near its maximum.

    **Timing**: a count changes three cycles after its event: events come late in their cycle, and
    the carry between the halves of a count is registered, so that no path is long.
    """

    def __init__(self, names: tuple[str, ...], bits: int = COUNTER_BITS):
        self.names, self.half = names, bits // 2
        ports = {
            # one bit per name, high for one cycle per event
            "event": In(data.StructLayout(dict.fromkeys(names, 1))),
            "clear": In(1),  # all counts are 0 in the next cycle, and events in flight are dropped
            # the counts, `bits` bits per name
            "value": Out(data.StructLayout(dict.fromkeys(names, bits))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        for name in self.names:
            self._counter(m, name)
        return m

    def _counter(self, m: Module, name: str):
        """One count. Its lower half is output a cycle late, when the upper half has its carry."""
        parts = ("low", "shown", "high")
        low, shown, high = (Signal(self.half, name=f"{name}_{part}") for part in parts)
        event, carry, full = (Signal(name=f"{name}_{bit}") for bit in ("event", "carry", "full"))
        m.d.comb += self.value[name].eq(Cat(shown, high))
        m.d.sync += [
            event.eq(self.event[name] & ~full),
            low.eq(low + event),
            carry.eq(event & low.all()),
            shown.eq(low),
            high.eq(high + carry),
            full.eq(high.all() & low[SPARE:].all()),
        ]
        with m.If(self.clear):
            m.d.sync += [signal.eq(0) for signal in (low, shown, high, event, carry, full)]
