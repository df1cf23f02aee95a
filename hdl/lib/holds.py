"""What the hardware relies on: inequalities when it is built, assertions in every simulation.

Where a stream is pushed without a look at its `ready`, or a count is trusted not to overflow, that
rests on latencies and depths elsewhere. `enough` holds them against each other when the hardware is
built; `holds` and the others have every simulation stop where they turn out wrong, but in a reset:
before the first one registers hold anything. Whatever is built for a platform, for synthesis or as
Verilog, has no assertions and so no gates for them.
"""

from amaranth.hdl import Assert, Elaboratable, Module, ResetSignal, Signal, Value
from amaranth.lib import stream

BUILT = object()
"""A platform for hardware that is built: without assertions, its memories as they are."""


def _stops(condition: Value, what: str) -> Assert:
    """Stops a simulation with the condition at 0, but in a reset."""
    return Assert(ResetSignal(allow_reset_less=True) | condition, what)


class _Holds(Elaboratable):
    """Asserts that a condition is 1 at every rising edge of the clock."""

    def __init__(self, condition: Value, what: str):
        self.condition, self.what = condition, what

    def elaborate(self, platform) -> Module:
        m = Module()
        if platform is None:
            m.d.sync += _stops(self.condition, self.what)
        return m


class _Keeps(Elaboratable):
    """Asserts that an offer stays as it is until it is taken."""

    def __init__(self, offered: stream.Interface, what: str):
        self.offered, self.what = offered, what

    def elaborate(self, platform) -> Module:
        m = Module()
        if platform is None:
            offer, waiting = self.offered, Signal()
            payload = Value.cast(offer.payload)
            before = Signal(len(payload))
            m.d.sync += [waiting.eq(offer.valid & ~offer.ready), before.eq(payload)]
            m.d.sync += _stops(~waiting | (offer.valid & (payload == before)), self.what)
        return m


def holds(m: Module, name: str, condition: Value, what: str):
    """Has simulations stop, with `what` is wrong, at a rising edge with the condition at 0.

    name: of the assertion, among the module's own.
    """
    m.submodules[f"holds_{name}"] = _Holds(condition, f"wrong: {what}\n")


def never_waits(m: Module, name: str, offered: stream.Interface, what: str):
    """Has simulations stop if an item is offered that is not taken in the same cycle."""
    holds(m, name, ~offered.valid | offered.ready, f"an item has no room, {what}")


def keeps(m: Module, name: str, offered: stream.Interface):
    """Has simulations stop if an offer is changed or taken back before it is taken."""
    m.submodules[f"keeps_{name}"] = _Keeps(offered, f"wrong: an offer was not kept, {name}\n")


def enough(there: int, needed: int, what: str):
    """ValueError unless there is as much as is needed."""
    if there < needed:
        raise ValueError(f"{what}: {there}, {needed} are needed")
