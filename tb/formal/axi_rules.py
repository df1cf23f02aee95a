"""Rules that all channels of AXI4 and AXI4-Lite have in common, as assertions on a port."""

from amaranth.hdl import Assert, Cat, Module, Mux, Signal, Value
from amaranth.lib import wiring

MOST = 7  # of what is counted here; no part holds as many


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
