"""Comparison of two floats."""

from amaranth.hdl import Module, Mux, Value, ValueLike
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline, spread
from splatcore.spec.number import Float


def compared(m: Module, name: str, format: Float, a: ValueLike, b: ValueLike) -> "Compare":
    """Add a combinational comparison to a module as submodule `name`."""
    m.submodules[name] = compare = Compare(format, 0)
    m.d.comb += [compare.a.eq(a), compare.b.eq(b), compare.enable.eq(1)]
    return compare


class Compare(wiring.Component):
    """less = a < b and equal = a = b; both are low if either is NaN. Zeros of both signs are equal.

    Codes without their sign are ordered as the values are, so one comparison of integers is enough.

    **Timing**: no multiplier, one item per cycle, `latency` cycles: any number, 0 is combinational.
    All registers are at the end.
    """

    def __init__(self, format: Float, latency: int):
        self.format = format
        self.registers = spread(latency, {"compare": 14})
        ports = {
            # codes of `format`
            "a": In(format.width),
            "b": In(format.width),
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
            # the results
            "less": Out(1),
            "equal": Out(1),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.format
        a, b = self._magnitude(self.a), self._magnitude(self.b)
        below, same = a < b, a == b
        less, equal = below, same
        if format.signed:
            a_negative, b_negative = self.a[-1], self.b[-1]
            zeros = same & ~a.any()
            less = Mux(a_negative, Mux(b_negative, ~below & ~same, ~zeros), ~b_negative & below)
            equal = (same & (a_negative == b_negative)) | zeros
        if format.overflow == "infinity":
            infinity = ((1 << format.exponent) - 1) << format.fraction
            ordered = (a <= infinity) & (b <= infinity)
            less, equal = less & ordered, equal & ordered
        less, equal = Pipeline(m, self.enable, self.registers).cut("compare", less, equal)
        m.d.comb += [self.less.eq(less), self.equal.eq(equal)]
        return m

    def _magnitude(self, code: Value) -> Value:
        """The code without its sign; 0 for a zero."""
        magnitude = code[: self.format.exponent + self.format.fraction]
        if self.format.subnormal:
            return magnitude
        return Mux(magnitude[self.format.fraction :].any(), magnitude, 0)
