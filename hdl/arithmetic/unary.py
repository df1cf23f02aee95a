"""Reciprocal and reciprocal square root of floats, by table and polynomial (`spec.unary`)."""

from collections import Counter
from functools import partial

from amaranth.hdl import Cat, Const, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.unary_ends import Pack, Unpack
from splatcore.hdl.lib.latency import Pipeline
from splatcore.spec.number import Float
from splatcore.spec.unary import Datapath, Function, coefficients, datapath, places_out

REGISTERS = ("packed", "looked_up", "summed", "unpacked", "multiplied")
"""Cuts that get the first, second … register; further registers follow the output, "packed"."""


class Lookup(wiring.Component):
    """Looks up the coefficients of a significand's interval, and computes their factors.

    **Timing**: a squarer of `reach` bits (degree 2); no registers.
    """

    def __init__(self, path: Datapath):
        self.path = path
        self.tables = coefficients(path)
        slope, curve = (max(table).bit_length() for table in self.tables[1:])
        terms = {"slope": slope, "below": path.rest, "curve": curve, "square": path.square}
        self.terms = tuple(terms)[: 2 * path.degree]
        ports = {
            # interval (high bits) and distance within it
            "significand": In(path.address + path.rest),
            "offset": Out(path.fraction + 1 + path.guard),  # constant coefficient
            # `slope` and `below`, from degree 1 on: linear coefficient and its factor; `curve` and
            # `square`, with degree 2: quadratic coefficient and its factor
            **{name: Out(terms[name]) for name in self.terms},
        }
        super().__init__(ports)

    def factors(self) -> tuple[Value, ...]:
        """Factors of the products in pairs: slope, below, curve, square, up to the degree."""
        return tuple(getattr(self, name) for name in self.terms)

    def elaborate(self, platform):
        m = Module()
        path, degree = self.path, self.path.degree
        rest, address = self.significand[: path.rest], self.significand[path.rest :]
        columns = ("offset", "slope", "curve")[: degree + 1]
        with m.Switch(address):
            for case, row in enumerate(zip(*self.tables, strict=True)):
                with m.Case(case):
                    for name, coefficient in zip(columns, row, strict=False):
                        m.d.comb += getattr(self, name).eq(coefficient)
        if degree >= 1:
            m.d.comb += self.below.eq(~rest)
        if degree >= 2:
            distance = rest[:-1] ^ (~rest[-1]).replicate(path.rest - 1)
            a = distance[path.reach_drop :]
            m.d.comb += self.square.eq(a * (a + 1) >> path.square_drop)
        return m


class Unary(wiring.Component):
    """1/x or 1/√x of a float: `Reciprocal` or `Rsqrt`.

    **Timing**: one multiplier (degree 2: a second one of about 4 × 5 bits and a squarer); one item
    per cycle; any latency from 0. The first five registers cut the path in the order of
    `REGISTERS`, further ones follow the output, for a tool that retimes.

    NAND2-equivalents without registers: Float(7, 16) 2.4 k, without subnormal values 2.3 k;
    binary16 0.7 k. For 1/√x: 2.7 k, 2.4 k, 0.8 k.
    """

    def __init__(self, function: Function, format: Float, latency: int):
        if latency < 0:
            raise ValueError(f"{function}: latency {latency} is negative")
        self.function, self.format, self.latency = function, format, latency
        extra = max(0, latency - len(REGISTERS))
        self.registers = Counter([*REGISTERS[:latency], *REGISTERS[:1] * extra])
        ports = {
            "a": In(format.width),  # code of `format`
            "enable": In(1),  # the pipeline advances; while it is low all registers hold
            "o": Out(format.width),  # code of the result, `latency` enabled cycles later
        }
        super().__init__(ports)

    def elaborate(self, platform):
        m = Module()
        path = datapath(self.function, self.format.fraction)
        m.submodules.unpack = unpack = Unpack(self.function, self.format)
        m.submodules.lookup = lookup = Lookup(path)
        m.submodules.pack = pack = Pack(self.function, self.format)

        cut = Pipeline(m, self.enable, self.registers).cut

        m.d.comb += unpack.a.eq(self.a)
        significand, result = cut("unpacked", unpack.significand, unpack.result)

        m.d.comb += lookup.significand.eq(significand)
        offset, *factors, result = cut("looked_up", lookup.offset, *lookup.factors(), result)
        products = [a * b for a, b in zip(factors[::2], factors[1::2], strict=True)]
        offset, *products, result = cut("multiplied", offset, *products, result)

        # A result that will be shifted right by n places is rounded here: 2^n − 1 half units more.
        places = range(places_out(self.function, self.format))
        half_units = Cat(Const(0, path.point - 1), *(result.places > n for n in places))
        total = Cat(Const(0, path.point - path.guard), offset) + half_units
        for product, shift in zip(products, (0, path.curve_shift), strict=False):
            total = total + (product << shift)
        fraction = total[path.point :][: path.fraction + 1]
        fraction, result = cut("summed", fraction, result)

        m.d.comb += [pack.fraction.eq(fraction), pack.result.eq(result)]
        (output,) = cut("packed", pack.o)
        m.d.comb += self.o.eq(output)
        return m


Reciprocal = partial(Unary, "reciprocal")
Rsqrt = partial(Unary, "rsqrt")
