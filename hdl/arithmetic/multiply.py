"""Multiplication of two floats."""

from amaranth.hdl import Cat, Const, Module, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.float import Number, Round, Unpack, Unpacked, operand
from splatcore.hdl.lib.latency import Pipeline, Registers, spread
from splatcore.hdl.lib.shift import sticky
from splatcore.spec.number import Float


class Multiply(wiring.Component):
    """o = a · b, rounded once.

    Parameters:
        format: of operands and result
        latency: number of registers, or their places

    **Timing**: one multiplier of `fraction` + 1 bits squared, one item per cycle, `latency` cycles:
    any number, 0 is combinational.
    """

    def __init__(self, format: Float, latency: int | Registers):
        self.format = format
        self.zeros = self._zeros(format)
        self.registers = spread(latency, self.cuts(format))
        ports = {
            # codes of `format`
            "a": In(format.width),
            "b": In(format.width),
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
            "o": Out(format.width),  # code of `format`
        }
        super().__init__(ports)

    @staticmethod
    def _zeros(format: Float) -> int:
        """Maximum number of leading zeros of the product that the rounder must handle."""
        # A subnormal significand times a normal one has at most `fraction` of them more; the
        # product of two subnormal values is too small to be normalised.
        return format.fraction + 1 if format.subnormal else 1

    @staticmethod
    def cuts(format: Float) -> dict[str, int]:
        """Cuts for registers: operands unpacked, product computed, and the cuts of `Round`."""
        # An operand may come through a multiplexer of a dozen sources.
        return {"operand": 6, "product": 30} | Round.cuts(format, Multiply._zeros(format))

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.format
        m.submodules.a = a = Unpack(format, clear=False)
        m.submodules.b = b = Unpack(format, clear=False)
        m.d.comb += [a.i.eq(self.a), b.i.eq(self.b)]
        pipeline = Pipeline(m, self.enable, self.registers)

        (factors,) = pipeline.cut("operand", self._factors(m, a.o, b.o))
        exact = self._product(factors.significand)
        width = min(len(exact), Round.width(format, self.zeros))
        product = Signal(self._layout(width))
        m.d.comb += [
            product.sign.eq(factors.sign),
            product.exponent.eq(factors.exponent),
            product.significand.eq(sticky(exact, width - 1) if width < len(exact) else exact),
            *product.flag(factors.infinity, factors.nan),
        ]
        (product,) = pipeline.cut("product", product)

        layout = product.shape()
        m.submodules.round = rounder = Round(format, layout, self.zeros, self.registers)
        m.d.comb += [rounder.i.eq(product), rounder.enable.eq(self.enable), self.o.eq(rounder.o)]
        return m

    def _layout(self, width: int) -> Unpacked:
        """Layout of the product: two bits before the binary point."""
        a, bias = operand(self.format), self.format.bias
        low, high = (2 * exponent - bias for exponent in (a.exponents[0], a.exponents[-1]))
        return Unpacked(range(low, high + 1), width, a.special)

    def _factors(self, m: Module, a: Number, b: Number) -> Number:
        """The product except its significand; in place of that the two factors' significands,
        concatenated.

        Without subnormal values only their fractions are included: all integer bits are set except
        in zeros, and a product with a zero gets an exponent below every other.
        """
        format = self.format
        both = Cat(a.significand, b.significand)
        if not format.subnormal:
            both = Cat(a.significand[:-1], b.significand[:-1])
        factors = Signal(self._layout(len(both)))
        # With a carry in, the bias to be subtracted is a power of two.
        carry = Const(1, 1)
        exponents = (Cat(carry, a.exponent) + Cat(carry, b.exponent))[1:]
        infinity = a.infinity | b.infinity
        if format.subnormal:
            zero = (a.significand == 0) | (b.significand == 0)
        else:
            zero = ~(a.significand[-1] & b.significand[-1])
        m.d.comb += [
            factors.sign.eq(a.sign ^ b.sign),
            factors.exponent.eq(exponents - (format.bias + 1)),
            factors.significand.eq(both),
            *factors.flag(infinity, a.nan | b.nan | (infinity & zero)),
        ]
        if not format.subnormal:
            with m.If(zero):
                m.d.comb += factors.exponent[-2:].eq(0b10)
        return factors

    def _product(self, both: Value) -> Value:
        """Product of two concatenated significands."""
        if self.format.subnormal:
            width = self.format.fraction + 1
            return both[width:] * both[:width]
        width, one = self.format.fraction, Const(1, 1)
        return Cat(both[width:], one) * Cat(both[:width], one)
