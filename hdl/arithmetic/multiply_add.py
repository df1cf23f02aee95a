"""The PE of the arrays: multiplication and addition of floats, each rounded."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.add import Add
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.hdl.lib.latency import Pipeline, spread
from splatcore.spec.number import Float


class MultiplyAdd(wiring.Component):
    """o = a · b + c, rounded after the multiplication and again after the addition.

    Members
        a, b, c: codes of `format`, all of one item at once.
        o: code of `format`.
        enable: the pipeline moves; while it is low everything stays where it is.

    **Timing**: one multiplier of `fraction` + 1 bits squared, an item per cycle, `latency` cycles:
    any number, 0 is combinational. Registers stand where they cut the whole path best: product and
    sum need not have their own.
    """

    def __init__(self, format: Float, latency: int):
        parts = {"multiply": Multiply.cuts(format), "add": Add.cuts(format)}
        path = {(part, cut): depth for part, cuts in parts.items() for cut, depth in cuts.items()}
        registers = spread(latency, path)
        own = {part: {cut: registers[part, cut] for cut in cuts} for part, cuts in parts.items()}
        self.multiply = Multiply(format, own["multiply"])
        self.add = Add(format, own["add"])
        self.delay = {"summand": sum(own["multiply"].values())}
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
            *(add.a.eq(multiply.o), add.b.eq(*pipeline.cut("summand", self.c))),
            *(add.enable.eq(self.enable), self.o.eq(add.o)),
        ]
        return m
