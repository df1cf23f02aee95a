"""Rules that all channels of AXI4 and AXI4-Lite have in common, as assertions on a port."""

from collections.abc import Callable

from amaranth.hdl import Assert, Cat, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import Out

from splatcore.hdl.lib.stream import Register
from tb.helpers.parts import forward

MOST = 7  # of what is counted here; no part holds as many


class Around(wiring.Component):
    """A part with rules about it; its inputs are free.

    Members
        part: all ports of the part. inner: the part itself.
    """

    def __init__(self, part: wiring.Component):
        super().__init__({"part": Out(part.signature)})
        self.inner = part

    def placed(self) -> Module:
        """A module with the part in it."""
        m = Module()
        m.submodules.part = self.inner
        forward(m, self.part, self.inner)
        return m


def kept(m: Module, valid: Value, ready: Value, payload: Value) -> None:
    """Assert that VALID stays, and its payload with it, until READY."""
    payload = Value.cast(payload)
    waiting, before = Signal(), Signal(len(payload))
    m.d.sync += [waiting.eq(valid & ~ready), before.eq(payload)]
    m.d.comb += Assert(~waiting | (valid & (payload == before)))


def channel(port: wiring.PureInterface, name: str) -> tuple[Value, Value, Value]:
    """VALID, READY and all payload of a channel of a port ("aw", "w", "b", "ar" or "r")."""
    handshake = (f"{name}valid", f"{name}ready")
    others = [k for k in port.signature.members if k.startswith(name) and k not in handshake]
    return getattr(port, handshake[0]), getattr(port, handshake[1]), wires(port, others)


def wires(port: wiring.PureInterface, names: list[str]) -> Value:
    """Several wires of a port."""
    return Cat(getattr(port, name) for name in names)


def passes(port: wiring.PureInterface, name: str) -> Value:
    """High if something passes on a channel."""
    valid, ready, _ = channel(port, name)
    return valid & ready


def open_ones(m: Module, comes: Value, goes: Value) -> Signal:
    """Count what has come and not gone."""
    count = Signal(range(MOST + 1))
    m.d.sync += count.eq(count + comes - goes)
    return count


def within(m: Module, waits: Value, cycles: int) -> None:
    """Assert that nothing waits for more cycles than that in a row."""
    count = Signal(range(cycles + 2))
    m.d.sync += count.eq(Mux(waits, count + 1, 0))
    m.d.comb += Assert(count <= cycles)


class InOrder:
    """What passes a `Register` to a channel of the port; asserts that it holds two at most, and
    offers each in order, once and unchanged, from the cycle on after it came.

    item: what comes, if `comes`; count: how many wait; first, second: these.
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
            # Why: where they are.
            Assert(count == register.o.valid + register.full),
            Assert(register.o.valid | ~register.full),
            Assert((count == 0) | (register.head == self.first)),
            Assert((count != 2) | (register.spare == self.second)),
        ]

    def those(self, which: Callable[[Value], Value]) -> Value:
        """How many of those that wait have such a client."""
        first, second = which(self.first.client), which(self.second.client)
        return ((self.count != 0) & first) + ((self.count == 2) & second)
