"""Design invariants: checked at elaboration, or asserted in every simulation.

Where a stream ignores `ready`, or a count is trusted not to overflow, that relies on latencies and
depths elsewhere. `enough` compares them at construction. `holds`, `never_waits` and `keeps` stop
every simulation in which the invariant fails, except during reset: before the first reset registers
hold no defined values. Hardware elaborated for a platform, for synthesis or as Verilog, has no
assertions and no gates for them.
"""

from amaranth.hdl import Assert, Elaboratable, Module, ResetSignal, Signal, Value
from amaranth.lib import stream

BUILT = object()
"""Platform for Verilog and synthesis: no assertions, memories kept as memories."""


def _stops(condition: Value, message: str) -> Assert:
    """Assertion that stops a simulation if the condition is 0, except during reset."""
    return Assert(ResetSignal(allow_reset_less=True) | condition, message)


class _Holds(Elaboratable):
    """Asserts that a condition is 1 at every rising edge of the clock."""

    def __init__(self, condition: Value, message: str):
        self.condition, self.message = condition, message

    def elaborate(self, platform) -> Module:
        m = Module()
        if platform is None:
            m.d.sync += _stops(self.condition, self.message)
        return m


class _Keeps(Elaboratable):
    """Asserts that an offer does not change until it is taken."""

    def __init__(self, offered: stream.Interface, message: str):
        self.offered, self.message = offered, message

    def elaborate(self, platform) -> Module:
        m = Module()
        if platform is None:
            offer, waiting = self.offered, Signal()
            payload = Value.cast(offer.payload)
            before = Signal(len(payload))
            m.d.sync += [waiting.eq(offer.valid & ~offer.ready), before.eq(payload)]
            m.d.sync += _stops(~waiting | (offer.valid & (payload == before)), self.message)
        return m


def holds(m: Module, name: str, condition: Value, violation: str):
    """Stop simulations, with the message `wrong: …`, at a rising edge with the condition at 0.

    name: of the assertion, unique within the module
    """
    m.submodules[f"holds_{name}"] = _Holds(condition, f"wrong: {violation}\n")


def never_waits(m: Module, name: str, offered: stream.Interface, item: str):
    """Stop simulations in which an item is offered and not taken in the same cycle."""
    holds(m, name, ~offered.valid | offered.ready, f"no room for {item}")


def keeps(m: Module, name: str, offered: stream.Interface):
    """Stop simulations in which an offer changes or is withdrawn before it is taken."""
    m.submodules[f"keeps_{name}"] = _Keeps(offered, f"wrong: an offer was not kept, {name}\n")


def enough(available: int, needed: int, limit: str):
    """Raise ValueError if `available` is less than `needed`."""
    if available < needed:
        raise ValueError(f"{limit}: {available}, {needed} are needed")
