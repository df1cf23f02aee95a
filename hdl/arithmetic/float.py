"""Unpacking, rounding and packing of floats, shared by all operations of `spec.number.Float`.

An operation unpacks its operands, computes on significands and exponents as integers, and passes
the result, exact or with a sticky bit for the missing bits below, to the one rounder `Round`.
"""

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value, ValueLike
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import bits_for

from splatcore.hdl.lib.latency import Pipeline, Registers
from splatcore.hdl.lib.shift import leading_zeros, shift_right_sticky, sticky
from splatcore.spec.number import Float

FLAGS = ("infinity", "nan")  # fields of a number in a format with such values


class Unpacked(data.StructLayout):
    """Layout of (−1)^sign · significand · 2^(exponent − bias), an infinity, or NaN.

    Parameters:
        exponents: values that the biased exponent can take
        width: bits of the significand; how many of them are before the binary point is up to the
            user
        special: whether there are infinities and NaN, and so flags for them
    """

    def __init__(self, exponents: range, width: int, special: bool):
        fields = {"sign": 1, "exponent": Shape.cast(exponents), "significand": width}
        super().__init__(fields | dict.fromkeys(FLAGS if special else (), 1))
        self.exponents = exponents
        self.special = special

    def __call__(self, target: ValueLike) -> "Number":
        return Number(self, target)


class Number(data.View):
    """A number in the layout `Unpacked`."""

    def __getattr__(self, name: str) -> Value | data.View:
        """A field. An absent flag reads as zero, so that logic behind it vanishes."""
        if name in FLAGS and not self.shape().special:
            return Const(0)
        return super().__getattr__(name)

    def flag(self, infinity: ValueLike, nan: ValueLike) -> list:
        """Statements that set the flags, if there are any."""
        if not self.shape().special:
            return []
        return [self.infinity.eq(infinity), self.nan.eq(nan)]


def operand(format: Float) -> Unpacked:
    """Layout of unpacked codes of a format: one bit of the significand before the binary point.

    That bit is set except for subnormal values, whose exponent is 1 (the code 0 stands for that),
    and zero. Without subnormal values it is 0 only for zero, whose exponent does not matter.
    """
    exponents = range(int(format.subnormal), 1 << format.exponent)
    return Unpacked(exponents, format.fraction + 1, format.overflow == "infinity")


class Unpack(wiring.Component):
    """Splits a float's code into sign, exponent and significand.

    Parameters:
        format: of the code
        clear: whether to clear the fraction of a zero whose code has one, which is possible in a
            format without subnormal values; if not, only the integer bit marks a zero

    **Timing**: combinational.
    """

    def __init__(self, format: Float, clear: bool = True):
        self.format = format
        self.clear = clear and not format.subnormal
        ports = {
            "i": In(format.width),  # code of `format`
            "o": Out(operand(format)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.format
        fraction = self.i[: format.fraction]
        exponent = self.i[format.fraction :][: format.exponent]
        normal = exponent.any()
        significand = Cat(fraction, normal)
        m.d.comb += [
            self.o.exponent.eq(exponent | ~normal if format.subnormal else exponent),
            self.o.significand.eq(Mux(normal, significand, 0) if self.clear else significand),
        ]
        if format.signed:
            m.d.comb += self.o.sign.eq(self.i[-1])
        special = exponent.all()
        m.d.comb += self.o.flag(infinity=special & ~fraction.any(), nan=special & fraction.any())
        return m


class Round(wiring.Component):
    """Normalises, rounds to nearest with ties to even, handles underflow and overflow, and packs.

    Only logic for the numbers that can arrive is built.

    Parameters:
        format: of the result
        layout: of the numbers that can arrive
        zeros: maximum leading zeros of the significand; one with more is zero, or too small to be
            normalised
        registers: number of registers at each cut

    **Timing**: no multiplier, one item per cycle; the latency is the sum of `registers`.
    """

    def __init__(self, format: Float, layout: Unpacked, zeros: int, registers: Registers):
        self.format, self.layout = format, layout
        self.zeros, self.registers = zeros, registers
        ports = {
            # the significand has two bits before the binary point; its lowest bit may be sticky if
            # `format.fraction` + 2 or more bits are behind the point
            "i": In(layout),
            "o": Out(format.width),  # code of `format`; 0 for a NaN if the format has none
            "enable": In(1),  # the pipeline advances
        }
        super().__init__(ports)

    @staticmethod
    def cuts(format: Float, zeros: int) -> dict[str, int]:
        """Cuts for registers: leading zeros counted; significand shifted and rounding decided; code
        packed.
        """
        shift = {"shift": 13 if zeros > 1 or format.subnormal else 5}
        return ({"count": 10} if zeros > 1 else {}) | shift | {"round": 10}

    @staticmethod
    def width(format: Float, zeros: int) -> int:
        """Bits of the significand that can affect the result, with a sticky bit below."""
        return format.fraction + 3 + _reach(zeros)

    def elaborate(self, platform) -> Module:
        m = Module()
        pipeline = Pipeline(m, self.enable, self.registers)
        i, left = pipeline.cut("count", self.i, self._leading_zeros(m))
        i, *parts = pipeline.cut("shift", i, *self._decided(*self._normalised(m, i, left)))
        code = self._packed(m, i, *self._rounded(m, *parts))
        m.d.comb += self.o.eq(*pipeline.cut("round", code))
        return m

    def _leading_zeros(self, m: Module) -> Value:
        """Number of bits to shift to the left."""
        top = Signal(self.zeros)
        m.d.comb += top.eq(self.i.significand[-self.zeros :])
        if self.format.subnormal:
            # A one at the last place whose exponent is not below the minimum ends the count.
            exponent = self.i.exponent
            for zeros, bit in enumerate(reversed(top)):
                underflows = exponent <= 0 if zeros == 0 else exponent == zeros
                with m.If(underflows):
                    m.d.comb += bit.eq(1)
        return leading_zeros(m, top)

    def _normalised(self, m: Module, i: Number, left: Value) -> tuple[Value, Value, Value]:
        """Biased exponent, in two parts (the adder that rounds adds one more bit), and significand.

        The significand is left with its integer bit, the fraction, a guard bit and a sticky bit.
        Subnormal values, whose exponent is 0, and zero have no integer bit.
        """
        # A shift to the left by `left` equals one to the right by `reach` − `left`, the complement,
        # of a value placed `reach` bits further to the left.
        kept, reach = self.format.fraction + 2, _reach(self.zeros)
        right = ~left
        if self.format.subnormal and self.layout.exponents[0] < 0:
            # Then `left` is 0: shift by `reach` − exponent.
            right = Mux(i.exponent < 0, ~i.exponent + (reach + 1), right)
        far_left = sticky(i.significand, kept + reach)
        significand = shift_right_sticky(m, far_left, right.as_unsigned(), kept + 1)

        # Together `i.exponent` − `left` + 1 if there is an integer bit.
        exponent, more = i.exponent - left, significand[-1]
        if self.zeros == 1:
            exponent, more = i.exponent, ~left & significand[-1]
        if self.format.subnormal:
            highest = Shape.cast(range(self.layout.exponents[-1] + 2)).width
            exponent = Mux(significand[-1], exponent, 0)[:highest]
        return exponent, more, significand

    def _decided(self, exponent: Value, more: Value, significand: Value) -> tuple[Value, ...]:
        """Replace guard and sticky bit by two bits: round up; some bit below the integer bit is
        set.
        """
        lost, guard, rest = significand[0], significand[1], significand[2:]
        return exponent, more, rest, guard & (lost | rest[0]), significand[:-1].any()

    def _rounded(
        self, m: Module, exponent: Value, more: Value, significand: Value, up: Value, below: Value
    ) -> tuple[Value, Value]:
        """Code of the magnitude, with bits set above it if it is too large; whether it is zero."""
        fraction, integer = significand[:-1], significand[-1]
        exact = Cat(fraction, exponent)
        # A carry out of the fraction goes to the exponent.
        total = exact + Cat(up, Const(0, len(fraction) - 1), more)
        if self.format.subnormal:
            return total, ~(exact.any() | more | up)
        # Above half of the smallest value (exponent 0) that value is nearest; half of it itself is
        # rounded to zero.
        normal = integer & (exponent > -more)
        smallest = integer & (exponent == -more) & below
        code = Signal(len(total))
        m.d.comb += code.eq(Mux(normal, total, smallest << self.format.fraction))
        return code, ~(normal | smallest)

    def _packed(self, m: Module, i: data.View, code: Value, zero: Value) -> Value:
        """Code with the sign, including infinity and NaN."""
        format = self.format
        width = format.exponent + format.fraction
        above = code[width:].any()
        magnitude, sign = Signal(width), Signal()
        m.d.comb += [magnitude.eq(code), sign.eq(i.sign)]
        if format.overflow == "infinity":
            infinity = ((1 << format.exponent) - 1) << format.fraction
            with m.If(above | code[format.fraction : width].all() | i.infinity):
                m.d.comb += magnitude.eq(infinity)
            quiet = infinity | 1 << (format.fraction - 1)
        else:
            with m.If(above | i.infinity):
                m.d.comb += magnitude.eq(-1)
            quiet = 0
        with m.If(i.nan):
            m.d.comb += [magnitude.eq(quiet), sign.eq(0)]
        if not format.signed:
            return Mux(sign, 0, magnitude)
        if format.overflow == "saturate":
            return Cat(magnitude, sign & (i.infinity | ~zero))
        return Cat(magnitude, sign)


def _reach(zeros: int) -> int:
    """Maximum shift to the left for which a count up to `zeros` has bits."""
    return (1 << bits_for(zeros)) - 1
