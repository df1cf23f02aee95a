"""Bursts of the AXI4 master: the rules of AXI, and checks of the channels AR and AW."""

from amaranth.hdl import Assert, Cat, Const, Module, Mux, Signal, Value

from splatcore.hdl.lib.stream import Register
from splatcore.hdl.memory.axi import Axi
from splatcore.spec.axi import (
    ADDRESS_BITS,
    BEAT,
    BOUNDARY,
    port_beats,
    port_bytes,
    window_bits,
)
from splatcore.spec.config import Config
from tb.formal.axi_rules import InOrder, channel

CHANNEL_DEPTH = 2
"""Items that the master holds per channel, at most."""

PAGE = BOUNDARY // BEAT
INCR = 1


def allowed(config: Config, burst) -> Value:
    """Return whether AXI allows a burst: no `BOUNDARY` crossed, and one beat if it is narrow."""
    beats = port_beats(config)
    first = burst.beat[: (PAGE - 1).bit_length()] & ~(beats - 1)
    fits = first + (burst.length + 1) * beats <= PAGE
    return fits & (~burst.narrow | (burst.length == 0))


def addresses(m: Module, part: Axi, name: str, register: Register, comes: Value, item) -> InOrder:
    """Check the offers of an address channel; returns the requests that wait for it.

    Asserts that each request is offered in order, with its client's ID and window, as a burst that
    AXI allows: INCR, of full-width beats or one narrow beat, without crossing `BOUNDARY`.
    """
    config, port = part.config, part.m_axi
    order = InOrder(m, register, comes, item, *channel(port, name)[:2])
    wires = {k: getattr(port, name + k) for k in ("id", "addr", "len", "size", "burst")}
    burst, valid = order.first.burst, order.count != 0
    size, of_beat = Signal(9, name=f"{name}_bytes"), Mux(burst.narrow, BEAT, port_bytes(config))
    m.d.comb += size.eq(1 << wires["size"])
    window = order.first.window if window_bits(config) else Const(0, 0)
    beats = wires["len"] + 1
    ends = Mux(burst.narrow, beats * BEAT, beats * port_bytes(config))
    m.d.comb += [
        Assert(~valid | (wires["id"] == order.first.client)),
        Assert(~valid | (wires["addr"][:ADDRESS_BITS] == (burst.beat * BEAT & ~(of_beat - 1)))),
        Assert(~valid | (wires["addr"][ADDRESS_BITS:] == window)),
        Assert(~valid | (wires["len"] == burst.length)),
        Assert(~valid | (size == of_beat)),
        Assert(wires["burst"] == INCR),
        Assert(~valid | (wires["addr"][: (BOUNDARY - 1).bit_length()] + ends <= BOUNDARY)),
        # Why: waiting requests are allowed bursts.
        Assert((order.count == 0) | allowed(config, burst)),
        Assert((order.count != CHANNEL_DEPTH) | allowed(config, order.second.burst)),
    ]
    return order


def at_most_one(bits: Value) -> Value:
    """Return whether at most one bit is set."""
    return (bits & (bits - 1))[: len(bits)] == 0


def works_for(clients: dict[str, int], half: int, client: Value) -> Value:
    """Return whether a client, by its ID, belongs to a half."""
    return Cat(client == k for k, of in enumerate(clients.values()) if of == half).any()
