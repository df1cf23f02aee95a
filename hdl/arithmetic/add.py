"""Addition of two floats, alone and behind a multiplication."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.float import Number, Round, Unpack, Unpacked, operand
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.hdl.lib.latency import Pipeline, Registers, spread
from splatcore.hdl.lib.shift import shift_right_sticky
from splatcore.spec.number import Float

BELOW = 3
"""Bits of the smaller summand below the fraction: after a subtraction that loses one leading bit,
a guard bit, one more bit and the sticky bit are left."""


class Add(wiring.Component):
    """o = a + b, rounded once.

    Parameters:
        format: of operands and result
        latency: number of registers, or their places

    **Timing**: no multiplier, one item per cycle, `latency` cycles: any number, 0 is combinational.
    """

    def __init__(self, format: Float, latency: int | Registers):
        self.format = format
        self.layout = Unpacked(
            operand(format).exponents, format.fraction + 2 + BELOW, operand(format).special
        )
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
        """Maximum number of leading zeros of the sum that the rounder must handle."""
        # A difference can lose all bits except the guard bit if the exponents differ by at most
        # one: then all bits below that bit are zero.
        return format.fraction + 2

    @staticmethod
    def cuts(format: Float) -> dict[str, int]:
        """Cuts for registers: summands ordered by magnitude, smaller one aligned, sum computed, and
        the cuts of `Round`.
        """
        rounding = Round.cuts(format, Add._zeros(format))
        return {"order": 14, "align": 18, "sum": 12} | rounding

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.format
        pipeline = Pipeline(m, self.enable, self.registers)
        m.submodules.a = a = Unpack(format, clear=False)
        m.submodules.b = b = Unpack(format, clear=False)
        m.d.comb += [a.i.eq(self.a), b.i.eq(self.b)]

        large, small = Signal(operand(format)), Signal(operand(format))
        distance = Signal(format.exponent)
        magnitude = format.exponent + format.fraction
        less = self.a[:magnitude] < self.b[:magnitude]
        with m.If(less):
            m.d.comb += [large.eq(b.o), small.eq(a.o)]
        with m.Else():
            m.d.comb += [large.eq(a.o), small.eq(b.o)]
        large, small = pipeline.cut("order", large, small)

        if self.registers["order"]:
            m.d.comb += distance.eq(large.exponent - small.exponent)
        else:  # both differences are computed while the summands are compared
            ahead, behind = a.o.exponent - b.o.exponent, b.o.exponent - a.o.exponent
            m.d.comb += distance.eq(Mux(less, behind, ahead))
        # A zero still has its fraction. In the larger summand it does no harm: its exponent is 0.
        significand = small.significand
        if not format.subnormal:
            significand = Mux(significand[-1], significand, 0)
        whole = Cat(Const(0, BELOW), significand)
        aligned = shift_right_sticky(m, whole, distance, len(whole))
        large, small, aligned = pipeline.cut("align", large, small, aligned)

        total = Signal(self.layout)
        m.d.comb += self._add(total, large, small, aligned)
        m.submodules.round = rounder = Round(format, self.layout, self.zeros, self.registers)
        m.d.comb += rounder.i.eq(*pipeline.cut("sum", total))
        m.d.comb += [rounder.enable.eq(self.enable), self.o.eq(rounder.o)]
        return m

    def _add(self, total: Number, large: Number, small: Number, aligned: Value) -> list:
        """Statements that compute the sum."""
        subtract = large.sign ^ small.sign
        shifted = Cat(Const(0, BELOW), large.significand)
        significand = shifted + (aligned ^ subtract.replicate(len(aligned))) + subtract
        carry = significand[len(aligned)] & ~subtract
        sign = large.sign
        if self.format.overflow == "infinity":  # such a format has −0, but x − x is +0
            zero = large.significand == aligned[BELOW:]
            if not self.format.subnormal:
                zero |= ~large.significand[-1]
            sign &= ~(subtract & zero)
        return [
            total.sign.eq(sign),
            total.exponent.eq(large.exponent),
            total.significand.eq(Cat(significand[: len(aligned)], carry)),
            *total.flag(
                infinity=large.infinity | small.infinity,
                nan=large.nan | small.nan | (large.infinity & small.infinity & subtract),
            ),
        ]


class MultiplyAdd(wiring.Component):
    """The PE of the arrays: o = a · b + c, rounded after the multiplication and after the addition.

    Parameters:
        format: of operands and result
        latency: number of registers

    **Timing**: one multiplier of `fraction` + 1 bits squared, one item per cycle, `latency` cycles:
    any number, 0 is combinational. Registers are placed so that they cut the whole path best;
    product and sum need not be registered.
    """

    def __init__(self, format: Float, latency: int):
        parts = {"multiply": Multiply.cuts(format), "add": Add.cuts(format)}
        path = {(part, cut): depth for part, cuts in parts.items() for cut, depth in cuts.items()}
        registers = spread(latency, path)
        own = {part: {cut: registers[part, cut] for cut in cuts} for part, cuts in parts.items()}
        self.multiply = Multiply(format, own["multiply"])
        self.add = Add(format, own["add"])
        self.delay = {"summand": sum(own["multiply"].values())}
        ports = {
            # codes of `format`, of the same item
            "a": In(format.width),
            "b": In(format.width),
            "c": In(format.width),
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
            "o": Out(format.width),  # code of `format`
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.multiply = multiply = self.multiply
        m.submodules.add = add = self.add
        pipeline = Pipeline(m, self.enable, self.delay)
        m.d.comb += [
            *(multiply.a.eq(self.a), multiply.b.eq(self.b), multiply.enable.eq(self.enable)),
            *(add.a.eq(multiply.o), add.b.eq(*pipeline.cut("summand", self.c))),
            *(add.enable.eq(self.enable), self.o.eq(add.o)),
        ]
        return m
