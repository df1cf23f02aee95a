"""Rules common to all channels of AXI4 and AXI4-Lite, as assertions on a port; bursts of AXI4."""

from collections.abc import Callable

from amaranth.hdl import Assert, Assume, Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

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
from tb.helpers.parts import forward

COUNT_MAX = 7  # of the counters here; no part holds that many items


class Around(wiring.Component):
    """A part to check, with free inputs.

    Members
        part: all ports of the part
        inner: the part itself
    ports: further inputs
    """

    def __init__(self, part: wiring.Component, **ports: wiring.Member):
        super().__init__({"part": Out(part.signature)} | ports)
        self.inner = part

    def placed(self) -> Module:
        """Return a module that contains the part."""
        m = Module()
        m.submodules.part = self.inner
        forward(m, self.part, self.inner)
        return m


def kept(m: Module, valid: Value, ready: Value, payload: Value) -> None:
    """Assert that VALID and its payload stay until READY."""
    payload = Value.cast(payload)
    waiting, before = Signal(), Signal(len(payload))
    m.d.sync += [waiting.eq(valid & ~ready), before.eq(payload)]
    m.d.comb += Assert(~waiting | (valid & (payload == before)))


def channel(port: wiring.PureInterface, name: str) -> tuple[Value, Value, Value]:
    """Return VALID, READY and the payload of a port's channel ("aw", "w", "b", "ar" or "r")."""
    handshake = (f"{name}valid", f"{name}ready")
    others = [k for k in port.signature.members if k.startswith(name) and k not in handshake]
    return getattr(port, handshake[0]), getattr(port, handshake[1]), wires(port, others)


def wires(port: wiring.PureInterface, names: list[str]) -> Value:
    """Concatenate several wires of a port."""
    return Cat(getattr(port, name) for name in names)


def passes(port: wiring.PureInterface, name: str) -> Value:
    """Return whether a channel transfers in this cycle."""
    valid, ready, _ = channel(port, name)
    return valid & ready


def outstanding(m: Module, comes: Value, goes: Value) -> Signal:
    """Count items that have come and not gone."""
    count = Signal(range(COUNT_MAX + 1))
    m.d.sync += count.eq(count + comes - goes)
    return count


def constant(m: Module, value: Value, changes: Value | int = 0) -> None:
    """Assume that a value stays, unless it may change in this cycle."""
    value = Value.cast(value)
    before, begun = Signal(len(value)), Signal()
    m.d.sync += [before.eq(value), begun.eq(1)]
    m.d.comb += Assume(~begun | changes | (value == before))


def within(m: Module, waits: Value, cycles: int) -> None:
    """Assert that `waits` is high for at most `cycles` cycles in a row."""
    count = Signal(range(cycles + 2))
    m.d.sync += count.eq(Mux(waits, count + 1, 0))
    m.d.comb += Assert(count <= cycles)


class InOrder:
    """A model of the two-entry `Register` in front of a channel of the port.

    Asserts that it holds at most two items, and offers each in order, once and unchanged, from the
    cycle after it entered.

    item: the item that enters, if `comes`
    count: number of waiting items
    first, second: the waiting items
    """

    def __init__(
        self, m: Module, register: Register, comes: Value, item: Value, valid: Value, ready: Value
    ):
        self.item = item
        self.first, self.second = (Signal(item.shape()) for _ in range(2))
        self.count = count = Signal(2)
        goes = valid & ready
        m.d.sync += count.eq(count + comes - goes)
        with m.If(goes | (count == 0)):
            m.d.sync += self.first.eq(Mux(count == 2, self.second, item))
        with m.If(comes):
            m.d.sync += self.second.eq(item)
        m.d.comb += [
            Assert(~comes | (count != 2)),
            Assert(valid == (count != 0)),
            # Why: places of the items in the register.
            Assert(count == register.o.valid + register.full),
            Assert(register.o.valid | ~register.full),
            Assert((count == 0) | (register.head == self.first)),
            Assert((count != 2) | (register.spare == self.second)),
        ]

    def count_of(self, which: Callable[[Value], Value]) -> Value:
        """Return the number of waiting items with a client that `which` accepts."""
        first, second = which(self.first.client), which(self.second.client)
        return ((self.count != 0) & first) + ((self.count == 2) & second)


CHANNEL_DEPTH = 2
"""Items that the master holds per channel, at most."""

PAGE = BOUNDARY // BEAT
INCR = 1


def allowed(config: Config, burst) -> Value:
    """Return whether AXI allows a burst: no `BOUNDARY` crossed."""
    beats = port_beats(config)
    first = burst.beat[: (PAGE - 1).bit_length()] & ~(beats - 1)
    return first + (burst.length + 1) * beats <= PAGE


def addresses(m: Module, part: Axi, name: str, register: Register, comes: Value, item) -> InOrder:
    """Check the offers of an address channel; returns the requests that wait for it.

    Asserts that each request is offered in order, with its client's ID and window, as a burst that
    AXI allows: INCR, of full beats, without crossing `BOUNDARY`.
    """
    config, port = part.config, part.m_axi
    order = InOrder(m, register, comes, item, *channel(port, name)[:2])
    wires = {k: getattr(port, name + k) for k in ("id", "addr", "len", "size", "burst")}
    burst, valid = order.first.burst, order.count != 0
    size, of_beat = Signal(9, name=f"{name}_bytes"), port_bytes(config)
    m.d.comb += size.eq(1 << wires["size"])
    window = order.first.window if window_bits(config) else Const(0, 0)
    beats = wires["len"] + 1
    ends = beats * of_beat
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
