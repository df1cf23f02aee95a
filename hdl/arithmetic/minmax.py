"""Clamp and maximum of floats, by comparing codes as integers."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.spec.number import Float


class Choice(wiring.Component):
    """Base class: selects one of two floats, or combines their parts.

    **Timing**: no multiplier, one item per cycle, latency 1.
    """

    def __init__(self, format: Float):
        ports = {
            # codes of a signed `format`
            "a": In(format.width),
            "b": In(format.width),
            "enable": In(1),  # the register loads; while it is low it holds
            "o": Out(format.width),  # code of `format`
        }
        super().__init__(ports)


class Clamp(Choice):
    """o = a limited to −b … b, for b ≥ 0."""

    def elaborate(self, platform) -> Module:
        m = Module()
        magnitude, sign = self.a[:-1], self.a[-1]
        with m.If(self.enable):
            m.d.sync += self.o.eq(Cat(Mux(magnitude > self.b, self.b[:-1], magnitude), sign))
        return m


class Maximum(Choice):
    """o = the larger of a and b."""

    def elaborate(self, platform) -> Module:
        m = Module()
        # As integers, codes of positive numbers rise with the value and codes of negative numbers
        # fall: with the sign inverted, and the rest of negative codes too, all rise.
        keys = []
        for name in ("a", "b"):
            code = getattr(self, name)
            key = Signal(len(code), name=f"{name}_key")
            m.d.comb += key.eq(Cat(code[:-1] ^ code[-1].replicate(len(code) - 1), ~code[-1]))
            keys.append(key)
        with m.If(self.enable):
            m.d.sync += self.o.eq(Mux(keys[0] < keys[1], self.b, self.a))
        return m
