"""Product of two floats."""

from amaranth.hdl import Module, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from hdl.float import Round, Unpack, Unpacked, operand
from hdl.latency import Pipeline, spread
from spec.number import Float


class Multiply(wiring.Component):
    """o = a · b, rounded once.

    Members
        a, b: codes of `format`.
        o: code of `format`.
        enable: the pipeline moves; while it is low everything stays where it is.

    Timing: one multiplier of `fraction` + 1 bits squared, an item per cycle, `latency` cycles:
    any number, 0 is combinational. Registers stand at the product and in `Round`.
    """

    def __init__(self, format: Float, latency: int):
        self.format = format
        # A subnormal significand brings at most `fraction` leading zeros to the product with a
        # normal one; the product of two subnormal ones is too small to be normalised.
        self.zeros = format.fraction + 1 if format.subnormal else 1
        self.registers = spread(latency, ("product", *Round.cuts(format, self.zeros)))
        code = format.width
        super().__init__({"a": In(code), "b": In(code), "enable": In(1), "o": Out(code)})

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.format
        m.submodules.a = a = Unpack(format)
        m.submodules.b = b = Unpack(format)
        m.d.comb += [a.i.eq(self.a), b.i.eq(self.b)]

        layout = self._layout()
        m.submodules.round = rounder = Round(format, layout, self.zeros, self.registers)
        product = Signal(layout)
        m.d.comb += self._multiply(product, a.o, b.o)
        pipeline = Pipeline(m, self.enable, self.registers)
        m.d.comb += rounder.i.eq(*pipeline.cut("product", product))
        m.d.comb += [rounder.enable.eq(self.enable), self.o.eq(rounder.o)]
        return m

    def _layout(self) -> Unpacked:
        """Layout of the exact product: two bits before the binary point."""
        format = self.format
        a = operand(format)
        low, high = (2 * exponent - format.bias for exponent in (a.exponents[0], a.exponents[-1]))
        return Unpacked(range(low, high + 1), 2 * format.fraction + 2, a.special)

    def _multiply(self, product: data.View, a: data.View, b: data.View) -> list:
        """Statements that make the product."""
        statements = [
            product.sign.eq(a.sign ^ b.sign),
            product.exponent.eq(a.exponent + b.exponent - self.format.bias),
            product.significand.eq(a.significand * b.significand),
        ]
        if self.format.overflow == "infinity":
            infinity = a.infinity | b.infinity
            zero = (a.significand == 0) | (b.significand == 0)
            statements += [
                product.infinity.eq(infinity),
                product.nan.eq(a.nan | b.nan | (infinity & zero)),
            ]
        return statements
