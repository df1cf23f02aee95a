"""Conversion between float formats, and between floats and fixed point."""

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value, ValueLike
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.float import Round, Unpack, Unpacked, operand
from splatcore.hdl.lib.latency import Pipeline, Registers, spread
from splatcore.hdl.lib.shift import shift_right_sticky, sticky
from splatcore.spec.number import Fixed, Float


def converted(m: Module, name: str, part: wiring.Component, value: ValueLike) -> Value:
    """A value converted by a part without registers, submodule `name`."""
    m.submodules[name] = part
    m.d.comb += [part.i.eq(value), part.enable.eq(1)]
    return part.o


class Convert(wiring.Component):
    """o = i · 2^scale in another floating-point format, rounded once.

    **Timing**: no multiplier, one item per cycle, `latency` cycles: any number, 0 is combinational.
    """

    def __init__(self, source: Float, target: Float, latency: int, scale: int = 0):
        self.source, self.target = source, target
        self.rebias = target.bias - source.bias + scale
        # Values that are subnormal in both formats are not normalised.
        normalise = self.rebias > 0 or not target.subnormal
        self.zeros = source.fraction + 1 if source.subnormal and normalise else 1
        self.registers = spread(latency, Round.cuts(target, self.zeros))
        ports = {
            "i": In(source.width),  # code of `source`
            "o": Out(target.width),  # code of `target`; 0 for a NaN if `target` has none
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.unpack = unpack = Unpack(self.source)
        i = operand(self.source)
        exponents = range(i.exponents[0] + self.rebias, i.exponents[-1] + self.rebias + 1)
        layout = Unpacked(exponents, self.source.fraction + 2, i.special)
        m.submodules.round = rounder = Round(self.target, layout, self.zeros, self.registers)
        sign = unpack.o.sign
        if (self.source.overflow, self.target.overflow) == ("saturate", "infinity"):
            sign &= unpack.o.significand.any()  # a source without −0 makes none
        m.d.comb += [
            unpack.i.eq(self.i),
            rounder.i.sign.eq(sign),
            rounder.i.exponent.eq(unpack.o.exponent + self.rebias),
            rounder.i.significand.eq(unpack.o.significand),
            *rounder.i.flag(unpack.o.infinity, unpack.o.nan),
            rounder.enable.eq(self.enable),
            self.o.eq(rounder.o),
        ]
        return m


class FromFixed(wiring.Component):
    """o = i as a float, times a power of two if `scale` is given, rounded once.

    Parameters:
        fixed, format: of operand and result
        latency: number of registers
        scale: range of the exponents of the power of two

    **Timing**: no multiplier, one item per cycle, `latency` cycles: any number, 0 is combinational.
    """

    def __init__(self, fixed: Fixed, format: Float, latency: int, scale: range | None = None):
        self.fixed, self.format = fixed, format
        self.zeros = max(fixed.width - 1, 1)
        self.registers = spread(latency, {"magnitude": 10} | Round.cuts(format, self.zeros))
        # The highest bit of the magnitude is the higher of the two before the rounder's point.
        self.exponent = fixed.width - 2 - fixed.fraction + format.bias
        self.exponents = range(self.exponent, self.exponent + 1)
        ports = {
            "i": In(fixed.width),  # code of `fixed`
            "o": Out(format.width),  # code of `format`
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
        }
        self.scaled = scale is not None
        if self.scaled:
            # The rounder needs a range of exponents that includes 0, even if it is never reached.
            highest = max(self.exponent + scale[-1], 0)
            self.exponents = range(self.exponent + scale[0], highest + 1)
            # o = i · 2^scale
            ports["scale"] = In(Shape.cast(range(min(scale[0], -1), scale[-1] + 1)))
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        number = Signal(Unpacked(self.exponents, self.fixed.width, special=False))
        negative = self.i[-1] if self.fixed.signed else Const(0)
        m.d.comb += number.sign.eq(negative)
        m.d.comb += number.exponent.eq(self.exponent + (self.scale if self.scaled else 0))
        m.d.comb += number.significand.eq(Mux(negative, -self.i, self.i))
        layout = number.shape()
        m.submodules.round = rounder = Round(self.format, layout, self.zeros, self.registers)
        pipeline = Pipeline(m, self.enable, self.registers)
        m.d.comb += rounder.i.eq(*pipeline.cut("magnitude", number))
        m.d.comb += [rounder.enable.eq(self.enable), self.o.eq(rounder.o)]
        return m


class ToFixed(wiring.Component):
    """o = i in fixed point, rounded and saturated as `fixed` specifies; NaN becomes 0.

    Parameters:
        format, fixed: of operand and result
        latency: number of registers, or their places
        scale: range of exponents, for a factor that is a power of two

    **Timing**: no multiplier, one item per cycle, `latency` cycles: any number, 0 is combinational.
    Registers are behind the shift of the significand and at the end.
    """

    def __init__(
        self, format: Float, fixed: Fixed, latency: int | Registers, scale: range | None = None
    ):
        self.format, self.fixed = format, fixed
        self.registers = spread(latency, {"shift": 16, "round": 16})
        ports = {
            "i": In(format.width),  # code of `format`
            "o": Out(fixed.width),  # code of `fixed`
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
        }
        exponents = operand(format).exponents
        self.small = exponents[0]  # up to this exponent significands may have leading zeros
        self.scaled = scale is not None
        if self.scaled:
            self.small += scale[-1]
            exponents = range(exponents[0] + scale[0], exponents[-1] + scale[-1] + 1)
            # o = i · 2^scale
            ports["scale"] = In(Shape.cast(scale))
        self.exponents = exponents
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        pipeline = Pipeline(m, self.enable, self.registers)
        m.submodules.unpack = unpack = Unpack(self.format)
        m.d.comb += unpack.i.eq(self.i)
        i, exponents = unpack.o, self.exponents
        exponent = Signal(Shape.cast(exponents))
        m.d.comb += exponent.eq(i.exponent + (self.scale if self.scaled else 0))

        # The number of steps is the integer significand · 2^(exponent − unit). It is shifted right
        # from its place at exponent `highest`: any larger exponent is too large.
        unit = self.format.bias + self.format.fraction - self.fixed.fraction
        bits = self.fixed.integer + self.fixed.fraction
        highest = min(max(bits + unit - self.format.fraction, self.small), exponents[-1])
        steps = self._steps(i.significand, highest - unit)
        right = Signal(range(highest - exponents[0] + 1))
        m.d.comb += right.eq(highest - exponent)
        steps = shift_right_sticky(m, steps, right, len(steps))
        above = exponent > highest if highest < exponents[-1] else Const(0)
        too_large = above | i.infinity
        sign, nan, too_large, steps = pipeline.cut("shift", i.sign, i.nan, too_large, steps)

        result = self._saturated(m, sign, too_large, self._rounded(sign, steps))
        m.d.comb += self.o.eq(*pipeline.cut("round", Mux(nan, 0, result)))
        return m

    def _steps(self, significand: Value, left: int) -> Value:
        """significand · 2^left, with a guard bit and a sticky bit below the integer."""
        significand = Cat(Const(0, max(left, 0)), significand)
        behind = max(-left, 0)
        significand = Cat(significand, Const(0, max(behind - len(significand), 0)))
        return sticky(significand, len(significand) - behind + 1)

    def _rounded(self, sign: Value, steps: Value) -> Value:
        """Signed number of steps."""
        integer, guard, lost = steps[2:], steps[1], steps[0]
        up = {
            "nearest-even": guard & (lost | integer[:1].any()),
            "floor": sign & (guard | lost),
            "ceiling": ~sign & (guard | lost),
        }[self.fixed.rounding]
        # −(n + up) = ~n + ~up: one carry chain rounds and negates.
        negative = sign.replicate(len(integer) + 2)
        return ((integer ^ negative) + (up ^ sign))[: len(negative)].as_signed()

    def _saturated(self, m: Module, sign: Value, too_large: Value, steps: Value) -> Value:
        """The nearest code."""
        bits = self.fixed.integer + self.fixed.fraction
        result = Signal(self.fixed.width)
        m.d.comb += result.eq(steps)
        if self.fixed.signed:
            above = steps[bits:].any() & ~steps[bits:].all()
            with m.If(too_large | above):
                m.d.comb += result.eq(Cat((~sign).replicate(bits), sign))
        else:
            with m.If(sign):
                m.d.comb += result.eq(0)
            with m.Elif(too_large | steps[bits:].any()):
                m.d.comb += result.eq(-1)
        return result
