"""Wrappers of components: ports passed on, and counters read."""

from collections.abc import Iterable

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.spec.counters import COUNTER_BITS


def forward(m: Module, outer: wiring.Component, inner: wiring.Component, names: Iterable[str] = ()):
    """Join members of a component with those of the same names of one inside it; all of the inner
    one's unless they are named.
    """
    members = inner.signature.members
    signature = wiring.Signature({name: members[name] for name in names or members})
    flat = zip(signature.flatten(outer), signature.flatten(inner), strict=True)
    for (_, member, port), (_, _, own) in flat:
        m.d.comb += own.eq(port) if member.flow is In else port.eq(own)


def counters(names: Iterable[str], bits: int) -> dict[str, int]:
    """Counters by name from the value of a port that has them side by side."""
    mask = (1 << COUNTER_BITS) - 1
    return {name: bits >> k * COUNTER_BITS & mask for k, name in enumerate(names)}
