"""Units of the opacity compensation of antialiased models, bit for bit as in `spec.compensation`.

Each takes one item per cycle; the result comes `latency` cycles after the operands.
"""

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline, spread
from splatcore.hdl.lib.shift import leading_zeros
from splatcore.spec.compensation import (
    CORRECTIONS,
    FADE,
    LOG_FRACTION,
    LOG_INDEX,
    PRODUCT_BITS,
    SUM_INDEX,
    SUM_INTEGER,
    SUMS,
    log_format,
    product_exponents,
)
from splatcore.spec.config import Config
from splatcore.spec.number import Float


def product_layout(config: Config) -> data.StructLayout:
    """Layout of a product: exponent above the minimum (0 for zero), significand with the leading
    one.
    """
    exponent = range(len(product_exponents(config)))
    return data.StructLayout({"sign": 1, "exponent": exponent, "significand": PRODUCT_BITS})


def parts(format: Float, code: Value) -> tuple[Value, Value, Value]:
    """Sign, biased exponent and fraction of a float."""
    return code[-1], code[format.fraction :][: format.exponent], code[: format.fraction]


def log_width(config: Config) -> int:
    """Bits of a logarithm's code."""
    return log_format(config).width


def logarithm(exponent: Value, below: Value) -> Value:
    """Code of log2 of a number with this signed exponent and these bits below its leading one."""
    whole = Cat(below[-LOG_FRACTION:], exponent).as_signed()
    return whole + table(CORRECTIONS, below[-LOG_INDEX:])


def table(entries: tuple[int, ...], index: Value) -> Value:
    """An entry of a table of constants."""
    width = max(entries).bit_length()
    return Array(Const(entry, width) for entry in entries)[index]


class Product(wiring.Component):
    """o = a · b, truncated to `PRODUCT_BITS` significant bits, exponent exact.

    **Timing**: a multiplier of `fraction` + 1 bits squared; any latency, 0 is combinational.
    """

    def __init__(self, config: Config, latency: int):
        self.config, self.format = config, config.arithmetic
        self.registers = spread(latency, {"operand": 6, "product": 30, "normalised": 3})
        code = self.format.width
        ports = {
            "a": In(code),  # codes of `Config.arithmetic`
            "b": In(code),  # codes of `Config.arithmetic`
            "enable": In(1),  # while it is low all registers hold
            "o": Out(product_layout(config).size),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        pipeline, format = Pipeline(m, self.enable, self.registers), self.format
        a, b = pipeline.cut("operand", self.a, self.b)
        (a_sign, a_exponent, a_fraction), (b_sign, b_exponent, b_fraction) = (
            parts(format, code) for code in (a, b)
        )
        exact = Cat(a_fraction, Const(1, 1)) * Cat(b_fraction, Const(1, 1))
        exact = Cat(Const(0, max(PRODUCT_BITS + 1 - len(exact), 0)), exact)
        some = a_exponent.any() & b_exponent.any()
        sums = Signal(range(len(product_exponents(self.config)) + 2))
        m.d.comb += sums.eq(a_exponent + b_exponent)
        sign, sums, some, top = pipeline.cut(
            "product", a_sign ^ b_sign, sums, some, exact[-PRODUCT_BITS - 1 :]
        )
        carry = top[-1]
        made = Signal(product_layout(self.config))
        with m.If(some):
            m.d.comb += made.sign.eq(sign)
            # Biased exponents of numbers other than 0 are at least 1.
            m.d.comb += made.exponent.eq(sums - Mux(carry, 1, 2))
            m.d.comb += made.significand.eq(Mux(carry, top[1:], top[:-1]))
        m.d.comb += self.o.eq(*pipeline.cut("normalised", made))
        return m


class Minor(wiring.Component):
    """o = log2 (a − b)² − c; the minimum logarithm if a and b, truncated alike, are equal.

    **Timing**: no multiplier; latency 4: aligned, subtracted, normalised, logarithm.
    """

    def __init__(self, config: Config):
        self.config, shape = config, product_layout(config)
        code = log_width(config)
        ports = {
            "a": In(shape.size),  # `product_layout`
            "b": In(shape.size),  # `product_layout`
            "c": In(code),  # a logarithm
            "enable": In(1),  # while it is low all registers hold
            "o": Out(code),  # a logarithm
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        cut = Pipeline(m, self.enable, dict.fromkeys(("align", "sum", "shift", "log"), 1)).cut
        a, b = (data.View(product_layout(self.config), code) for code in (self.a, self.b))
        ahead = Signal(signed(len(a.exponent) + 1))
        m.d.comb += ahead.eq(a.exponent - b.exponent)
        less = ahead[-1]
        large, small = (
            Mux(less, b.significand, a.significand),
            Mux(less, a.significand, b.significand),
        )
        distance = Mux(less, -ahead, ahead)[: len(a.exponent)]
        places = PRODUCT_BITS.bit_length()
        aligned = Mux(distance[places:].any(), 0, small >> distance[:places])
        exponent = Mux(less, b.exponent, a.exponent)
        added, large, small, exponent, subtrahend = cut(
            "align", a.sign ^ b.sign, large, aligned, exponent, self.c
        )
        # The number with the smaller exponent is not the larger one, unless exponents are equal.
        difference = large - small
        size = Signal(PRODUCT_BITS + 1)
        negated = Mux(difference[-1], small - large, difference)
        m.d.comb += size.eq(Mux(added, large + small, negated))
        size, exponent, subtrahend = cut("sum", size, exponent, subtrahend)
        zeros = leading_zeros(m, size)
        below = (size << zeros)[PRODUCT_BITS - LOG_FRACTION : PRODUCT_BITS]
        nothing, below, zeros, exponent, subtrahend = cut(
            "shift", ~size.any(), below, zeros, exponent, subtrahend
        )
        # The highest bit of `size` is worth 2^1 where a significand's is 2^0.
        least = product_exponents(self.config)[0]
        width = log_width(self.config)
        power = Signal(signed(width - LOG_FRACTION))
        m.d.comb += power.eq(exponent - zeros + (least + 1))
        doubled = Cat(Const(0, 1), logarithm(power, below)).as_signed()
        result = Mux(nothing, 1 << width - 1, (doubled - subtrahend.as_signed())[:width])
        m.d.comb += self.o.eq(*cut("log", result))
        return m


class Log(wiring.Component):
    """o = log2 |a|; for 0 that is −bias.

    **Timing**: no multiplier, latency 1.
    """

    def __init__(self, config: Config):
        self.format, self.width = config.arithmetic, log_width(config)
        ports = {
            "a": In(self.format.width),  # code of `Config.arithmetic`
            "enable": In(1),  # while it is low all registers hold
            "o": Out(self.width),  # a logarithm
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        _, biased, fraction = parts(self.format, self.a)
        power = Signal(signed(self.width - LOG_FRACTION))
        m.d.comb += power.eq(biased - self.format.bias)
        below = Cat(Const(0, max(LOG_FRACTION - len(fraction), 0)), Mux(biased.any(), fraction, 0))
        with m.If(self.enable):
            m.d.sync += self.o.eq(logarithm(power, below))
        return m


class LogSum(wiring.Component):
    """o = log2 (2^a + 2^b).

    **Timing**: no multiplier; latency 2: difference, sum.
    """

    def __init__(self, config: Config):
        self.width = code = log_width(config)
        ports = {
            # logarithms
            "a": In(code),
            "b": In(code),
            "enable": In(1),  # while it is low all registers hold
            "o": Out(code),  # a logarithm
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        cut = Pipeline(m, self.enable, {"difference": 1, "sum": 1}).cut
        a, b = self.a.as_signed(), self.b.as_signed()
        ahead = a - b
        less = ahead[-1]
        largest = Mux(less, b, a)
        distance = Mux(less, -ahead, ahead)[: self.width]
        far = distance[LOG_FRACTION + SUM_INTEGER :].any()
        index = distance[LOG_FRACTION - SUM_INDEX :][: SUM_INDEX + SUM_INTEGER]
        largest, far, index = cut("difference", largest, far, index)
        total = Signal(self.width)
        m.d.comb += total.eq(largest + Mux(far, 0, table(SUMS, index)))
        m.d.comb += self.o.eq(*cut("sum", total))
        return m


class Fade(wiring.Component):
    """o = a − b, at least 0 and at most `FADE.max`, in steps of opacity as a float.

    Models without compensation multiply `o` by 0 and never load it, so it is reset to a number.

    **Timing**: no multiplier; latency 2: difference, float.
    """

    def __init__(self, config: Config):
        self.format = config.arithmetic
        code = log_width(config)
        ports = {
            # logarithms
            "a": In(code),
            "b": In(code),
            "enable": In(1),  # while it is low all registers hold
            "o": Out(self.format.width),  # code of `Config.arithmetic`
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        cut = Pipeline(m, self.enable, {"difference": 1}).cut
        difference = self.a.as_signed() - self.b.as_signed()
        width = FADE.width
        (steps,) = cut(
            "difference", Mux(difference[width:].any(), (1 << width) - 1, difference[:width])
        )
        zeros = leading_zeros(m, steps)
        exponent = Signal(self.format.exponent)
        m.d.comb += exponent.eq(self.format.bias + FADE.integer - 1 - zeros)
        fraction = Cat(Const(0, self.format.fraction), (steps << zeros)[: width - 1])
        fraction = fraction[-self.format.fraction :]
        code = Mux(steps.any(), Cat(fraction, exponent, Const(0, 1)), 0)
        with m.If(self.enable):
            m.d.sync += self.o.eq(code)
        return m
