"""Unpacking and packing of floats for reciprocal and reciprocal square root."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, enum, wiring
from amaranth.lib.wiring import In, Out

from splatcore.spec.number import Float
from splatcore.spec.unary import Function, exponent_max, places_in, places_out, result_exponent


class Fraction(enum.Enum, shape=2):
    """Source of a result's fraction."""

    COMPUTED = 0
    ZEROS = 1
    FILLED = 2  # ones for the largest value, only the quiet bit for NaN


def result_layout(function: Function, format: Float) -> data.StructLayout:
    """Layout of a result before its fraction is computed."""
    layout = {
        "sign": 1,
        "exponent": format.exponent,  # 0 if subnormal
        "kind": Fraction,
    }
    if most := places_out(function, format):
        layout["places"] = range(most + 1)  # 0 unless subnormal; only for a computed fraction
    return data.StructLayout(layout)


class Unpack(wiring.Component):
    """Unpacks and normalises a float, and finds the exponent or special value of the result.

    **Timing**: no registers, no multipliers.
    """

    def __init__(self, function: Function, format: Float):
        self.function, self.format = function, format
        root = function == "rsqrt"
        ports = {
            "a": In(format.width),  # code of `format`
            # fraction below the leading one; for 1/√x with the exponent's parity on top
            "significand": Out(format.fraction + root),
            "result": Out(result_layout(function, format)),
        }
        super().__init__(ports)

    def elaborate(self, platform):
        m = Module()
        format, result = self.format, self.result
        fraction = self.a[: format.fraction]
        biased = self.a[format.fraction :][: format.exponent]
        empty = biased == 0
        normal, places, small = self._normalised(Cat(fraction, ~empty))
        effective = Mux(empty, 1 - places, biased) if format.subnormal else biased
        parity = ~effective[0]  # the bias is odd
        m.d.comb += self.significand.eq(Cat(normal[: format.fraction], parity))

        exponent = Signal.like(result_exponent(self.function, format, effective))
        m.d.comb += exponent.eq(result_exponent(self.function, format, effective))
        sign = self.a[-1] if format.signed else Const(0, 1)
        m.d.comb += [result.sign.eq(sign), result.exponent.eq(exponent)]
        m.d.comb += result.kind.eq(Fraction.COMPUTED)
        self._underflow(m, exponent)
        self._special(m, sign, fraction, biased, small)
        return m

    def _normalised(self, significand: Value) -> tuple[Value, Value, Value]:
        """Significand with its leading one on top, number of places shifted, and whether this
        failed.

        It fails for a zero, or a value so small that its result overflows like a zero's.
        """
        limit = places_in(self.function, self.format)
        steps = [1 << bit for bit in reversed(range(limit.bit_length()))]
        shifted = []
        for step in steps:
            shift = significand[-step:] == 0
            significand = Mux(shift, significand << step, significand)[: len(significand)]
            shifted.insert(0, shift)
        places = Cat(*shifted)
        small = ~significand[-1]
        if limit < min(sum(steps), self.format.fraction):
            small = small | (places > limit)
        return significand, places, small

    def _underflow(self, m: Module, exponent: Value) -> None:
        """Results below the normal range: places to shift by, or the nearer of two values."""
        result = self.result
        if self.format.subnormal:
            if places_out(self.function, self.format):
                with m.If(exponent < 1):
                    m.d.comb += [result.exponent.eq(0), result.places.eq(1 - exponent)]
            return
        with m.If(exponent == 0):
            m.d.comb += [result.exponent.eq(1), result.kind.eq(Fraction.ZEROS)]
        with m.If(exponent < 0):
            m.d.comb += [result.exponent.eq(0), result.kind.eq(Fraction.ZEROS)]

    def _special(self, m: Module, sign: Value, fraction: Value, biased: Value, small: Value):
        """Results that do not depend on a finite input's value; the last assignment wins."""
        result = self.result
        saturate = self.format.overflow == "saturate"
        root = self.function == "rsqrt"
        ones = result.exponent.eq(-1)
        filled = [ones, result.kind.eq(Fraction.FILLED)]
        if saturate:
            if root:
                m.d.comb += result.sign.eq(0)
            with m.If(small | sign if root else small):
                m.d.comb += filled
            return
        if root:
            with m.If(sign):
                m.d.comb += [*filled, result.sign.eq(0)]
        with m.If(small):
            m.d.comb += [ones, result.kind.eq(Fraction.ZEROS), result.sign.eq(sign)]
        with m.If(biased.all()):
            with m.If(fraction.any()):
                m.d.comb += [*filled, result.sign.eq(0)]
            with m.Elif(~sign if root else 1):
                m.d.comb += [result.exponent.eq(0), result.kind.eq(Fraction.ZEROS)]


class Pack(wiring.Component):
    """Packs a result from its layout and its fraction.

    **Timing**: no registers, no multipliers.
    """

    def __init__(self, function: Function, format: Float):
        self.function, self.format = function, format
        ports = {
            # rounded, with one bit more than the format's, which carries into the exponent
            "fraction": In(format.fraction + 1),
            "result": In(result_layout(function, format)),
            "o": Out(format.width),  # code of `format`
        }
        super().__init__(ports)

    def elaborate(self, platform):
        m = Module()
        format, result = self.format, self.result
        saturate = format.overflow == "saturate"
        computed = result.kind == Fraction.COMPUTED
        filled = result.kind == Fraction.FILLED
        low, carry = self.fraction[:-1], self.fraction[-1]

        if places_out(self.function, format):
            # The leading one of a subnormal result is part of the fraction, or the exponent's 1.
            low = (Cat(low, ~carry, carry) >> result.places)[: format.fraction]
            carry = carry & (result.places < 2)
        carry = carry & computed
        fill = filled.replicate(format.fraction)
        if not saturate:
            fill = Cat(Const(0, format.fraction - 1), filled)
        fraction = low & computed.replicate(format.fraction) | fill
        exponent = (result.exponent + carry)[: format.exponent]
        # The result of some input may be rounded up beyond the highest exponent.
        highest = result_exponent(self.function, format, 1 - places_in(self.function, format))
        if saturate and highest >= exponent_max(format):
            over = carry & result.exponent.all()
            fraction = fraction | over.replicate(format.fraction)
            exponent = exponent | over.replicate(format.exponent)
        magnitude = Cat(fraction, exponent)

        sign = result.sign & magnitude.any() if saturate else result.sign
        m.d.comb += self.o.eq(Cat(magnitude, sign))
        return m
