"""Components for tests: a datapath in a `Pipe`, and several components in one simulation."""

from collections.abc import Iterable

from amaranth.hdl import Module, ShapeLike, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.stream import Pipe


def forward(m: Module, outer: object, inner: wiring.Component, names: Iterable[str] = ()):
    """Connect members of a component or interface with those of an inner component.

    names: of the members; default: all of the inner component's
    """
    members = inner.signature.members
    signature = wiring.Signature({name: members[name] for name in names or members})
    flat = zip(signature.flatten(outer), signature.flatten(inner), strict=True)
    for (_, member, port), (_, _, own) in flat:
        m.d.comb += own.eq(port) if member.flow is In else port.eq(own)


class Piped(wiring.Component):
    """A datapath of registers with the handshake of a `Pipe`, built like a stage.

    Members: streams `i` and `o` of `shape`

    Attributes: `pipe` and `data`, the item in each stage, for proofs
    """

    def __init__(self, shape: ShapeLike, latency: int):
        super().__init__({"i": In(stream.Signature(shape)), "o": Out(stream.Signature(shape))})
        self.pipe = Pipe(latency)
        self.data = [Signal(shape, name=f"data{k}", reset_less=True) for k in range(latency)]

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pipe = pipe = self.pipe
        m.d.comb += [
            pipe.i.valid.eq(self.i.valid),
            self.i.ready.eq(pipe.i.ready),
            self.o.valid.eq(pipe.o.valid),
            pipe.o.ready.eq(self.o.ready),
            self.o.payload.eq(self.data[-1]),
        ]
        before = [self.i.payload, *self.data]
        for loads, value, after in zip(pipe.loads, before, self.data, strict=False):
            with m.If(loads):
                m.d.sync += after.eq(value)
        return m


class Handshake(wiring.Component):
    """A handshake for a component that is a pipeline with ports `i`, `enable` and `o`.

    Members: streams `i` and `o` with the shapes of its ports
    """

    def __init__(self, inner: wiring.Component):
        self.inner = inner
        members = inner.signature.members
        i, o = (stream.Signature(members[name].shape) for name in "io")
        super().__init__({"i": In(i), "o": Out(o)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner, m.submodules.pipe = inner, pipe = self.inner, Pipe(self.inner.LATENCY)
        m.d.comb += [
            pipe.i.valid.eq(self.i.valid),
            self.i.ready.eq(pipe.i.ready),
            self.o.valid.eq(pipe.o.valid),
            pipe.o.ready.eq(self.o.ready),
            inner.i.eq(self.i.payload),
            inner.enable.eq(pipe.loads),
            self.o.payload.eq(inner.o),
        ]
        return m


class SideBySide(wiring.Component):
    """Several unconnected components in one build.

    Members: each component under its name, so a port `i` of component `x` is `x__i` in Verilog
    """

    def __init__(self, components: dict[str, wiring.Component], **ports: wiring.Member):
        super().__init__({name: Out(part.signature) for name, part in components.items()} | ports)
        self.components = components

    def elaborate(self, platform) -> Module:
        m = Module()
        for name, part in self.components.items():
            m.submodules[name] = part
            forward(m, getattr(self, name), part)  # `connect` cannot flip an array of interfaces
        return m
