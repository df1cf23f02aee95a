"""Product and sum of floats, each rounded."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from hdl.add import Add
from hdl.latency import Pipeline
from hdl.multiply import Multiply
from spec.number import Float


class MultiplyAdd(wiring.Component):
    """o = a · b + c, rounded after the multiplication and again after the addition.

    Members
        a, b, c: codes of `format`, all of one item at once.
        o: code of `format`.
        enable: the pipeline moves; while it is low everything stays where it is.

    Timing: one multiplier of `fraction` + 1 bits squared, an item per cycle, `latency` cycles: any
    number, 0 is combinational. The addition takes half of them, and one more if they are odd.
    """

    def __init__(self, format: Float, latency: int):
        self.multiply = Multiply(format, latency // 2)
        self.add = Add(format, latency - latency // 2)
        self.delay = {"product": latency // 2}
        code = format.width
        super().__init__(
            {"a": In(code), "b": In(code), "c": In(code), "enable": In(1), "o": Out(code)}
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.multiply = multiply = self.multiply
        m.submodules.add = add = self.add
        pipeline = Pipeline(m, self.enable, self.delay)
        m.d.comb += [
            *(multiply.a.eq(self.a), multiply.b.eq(self.b), multiply.enable.eq(self.enable)),
            *(add.a.eq(multiply.o), add.b.eq(*pipeline.cut("product", self.c))),
            *(add.enable.eq(self.enable), self.o.eq(add.o)),
        ]
        return m
