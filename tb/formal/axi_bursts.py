"""Bursts of the AXI4 master: which ones AXI allows, and the port's channels of addresses."""

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

ASIDE = 2
"""Items of a channel that the master holds at most."""

PAGE = BOUNDARY // BEAT
INCR = 1


def allowed(config: Config, burst) -> Value:
    """A `read_record` is within `BOUNDARY` bytes, and a part of a beat is a burst by itself."""
    beats = port_beats(config)
    first = burst.beat[: (PAGE - 1).bit_length()] & ~(beats - 1)
    fits = first + (burst.length + 1) * beats <= PAGE
    return fits & (~burst.narrow | (burst.length == 0))


def addresses(m: Module, part: Axi, name: str, register: Register, comes: Value, item) -> InOrder:
    """What waits for a channel of addresses, and assertions on what the channel offers.

    It is what was asked for, in its window, and a burst that AXI allows: of whole beats or a part
    of one, with addresses that grow, within `BOUNDARY` bytes.
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
        # Why: what waits is allowed.
        Assert((order.count == 0) | allowed(config, burst)),
        Assert((order.count != ASIDE) | allowed(config, order.second.burst)),
    ]
    return order


def at_most_one(bits: Value) -> Value:
    """No two bits are 1."""
    return (bits & (bits - 1))[: len(bits)] == 0


def works_for(clients: dict[str, int], half: int, client: Value) -> Value:
    """The client, by its ID, is one of a half's."""
    return Cat(client == k for k, of in enumerate(clients.values()) if of == half).any()
