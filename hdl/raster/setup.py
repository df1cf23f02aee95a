"""Stage 3, third step: E = log2(alpha) of a splat as a polynomial around a tile."""

from amaranth.hdl import Cat, Const, Module, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import layout
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.feature import POSITION
from splatcore.spec.memory import OPACITY
from splatcore.spec.raster import (
    EXPONENT_INTEGER,
    FACTOR_FRACTION,
    GRADIENT_INTEGER,
    LEAN_INTEGER,
    LENGTH_INTEGER,
    SHIFT_MIN,
    SLOPE,
    around_record,
    pair_record,
)

CUTS = ("pair", "way", "product", "lean", "distance", "length", "slope", "square", "sum")
"""Registers are behind the values with these names."""


def outside(value: Value, integer: int, fraction: int) -> Value:
    """High if a signed number is out of range."""
    above = value[integer + fraction :]
    return above.any() & ~above.all()


def shifted(value: Value, code: Value, most: int) -> Value:
    """A signed value · 2^−(code + SHIFT_MIN), rounded down.

    most: maximum shift to the left; only a number that becomes 0 is shifted farther
    """
    wide = Cat(Const(0, most), value).as_signed()
    return wide >> (code + (SHIFT_MIN + most))[: len(code)]


class Setup(wiring.Component):
    """E's coefficients for a splat and a tile, in a pipeline without its own handshake.

    **Timing**: one pair per cycle; six multipliers of 11 to 19 × 20 bits.
    """

    LATENCY = len(CUTS)

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(layout(pair_record(config))),
            "enable": In(self.LATENCY),  # bit k: an item enters the registers of the k-th cut
            "o": Out(layout(around_record(config))),  # `LATENCY` enabled cycles later
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        self.pipeline = Pipeline(m, self.enable, dict.fromkeys(CUTS, 1))
        splat = self.i.splat
        values = {name: splat[name] for name in splat.shape().members}
        values |= {"tile": self.i.tile, "end": self.i.end}
        values |= {"column": self.i.column, "row": self.i.row}
        steps = (
            dict, self._way, self._product, self._lean, self._distance, self._length, self._slope,
            self._square, self._sum,
        )  # fmt: skip
        for cut, step in zip(CUTS, steps, strict=True):
            values = step(values)
            registers = self.pipeline.cut(cut, *values.values())
            values = dict(zip(values, registers, strict=True))
        o = self.o
        m.d.comb += [
            o[name].eq(values.pop(name)) for name in o.shape().members if name != "quadratic"
        ]
        m.d.comb += [o.quadratic[name].eq(values.pop(name)) for name in o.quadratic.shape().members]
        assert not values, f"{', '.join(values)}: carried for nothing"
        return m

    def _way(self, values: dict[str, Value]) -> dict[str, Value]:
        """From the splat's centre to the tile's, in steps of `POSITION`."""
        half = (TILE - 1) << POSITION.fraction >> 1
        bits = (TILE << POSITION.fraction).bit_length() - 1
        scale = values.pop("scale")
        for name, at, centre in (("dx", "column", "u"), ("dy", "row", "v")):
            position = Cat(Const(half, bits), values.pop(at)) >> scale
            values[name] = (position - values.pop(centre).as_signed())[
                : POSITION.width + 1
            ].as_signed()
        return values

    def _product(self, values: dict[str, Value]) -> dict[str, Value]:
        values["product"] = values.pop("shear").as_signed() * values["dy"]
        return values

    def _lean(self, values: dict[str, Value]) -> dict[str, Value]:
        fraction = self.config.exponent_fraction
        lean = shifted(values.pop("product"), values.pop("lean_shift"), -SHIFT_MIN)
        values["far"] = outside(lean, LEAN_INTEGER, fraction)
        values["lean"] = lean[: LEAN_INTEGER + 1 + fraction].as_signed()
        return values

    def _distance(self, values: dict[str, Value]) -> dict[str, Value]:
        guard = self.config.exponent_fraction - POSITION.fraction
        values["t"] = (values.pop("dx") << guard) - values.pop("lean")
        values["d"] = values.pop("dy") << guard
        return values

    def _length(self, values: dict[str, Value]) -> dict[str, Value]:
        """Lengths across and along the ellipse, normalised."""
        fraction = self.config.exponent_fraction
        far = values["far"]
        for name, shift in (("t", "across_shift"), ("d", "along_shift")):
            length = shifted(values[name], values.pop(shift), -SHIFT_MIN)
            far |= outside(length, LENGTH_INTEGER, fraction)
            values[name] = length[: LENGTH_INTEGER + 1 + fraction].as_signed()
        values["far"] = far
        return values

    def _slope(self, values: dict[str, Value]) -> dict[str, Value]:
        values["slope_t"] = (values.pop("across") * values["t"]) >> FACTOR_FRACTION
        values["slope_d"] = (values.pop("along") * values["d"]) >> FACTOR_FRACTION
        return values

    def _square(self, values: dict[str, Value]) -> dict[str, Value]:
        fraction = self.config.exponent_fraction
        values["square_t"] = (values["slope_t"] * values.pop("t")) >> fraction
        values["square_d"] = (values["slope_d"] * values.pop("d")) >> fraction
        values["leaning"] = (values.pop("slope").as_signed() * values["slope_t"]) >> SLOPE.fraction
        values["gx"] = -self._slope_shifted(values.pop("slope_t"), values.pop("k"))
        values["slope_d"] = self._slope_shifted(values["slope_d"], values.pop("m"))
        return values

    def _slope_shifted(self, slope: Value, code: Value) -> Value:
        """slope · 2^(1 − k); k is at least −1."""
        wide = Cat(Const(0, 2), slope).as_signed()
        return wide >> (code + (SHIFT_MIN + 1))[: len(code)]

    def _sum(self, values: dict[str, Value]) -> dict[str, Value]:
        fraction = self.config.exponent_fraction
        opacity = values.pop("opacity") << (fraction - OPACITY.fraction)
        e = -opacity - (values.pop("square_t") + values.pop("square_d"))
        gy = (values.pop("leaning") << 1) - values.pop("slope_d")
        gx = values["gx"]
        far = values.pop("far") | outside(e, EXPONENT_INTEGER, fraction)
        far |= outside(gx, GRADIENT_INTEGER, fraction) | outside(gy, GRADIENT_INTEGER, fraction)
        gx, gy = (slope[: GRADIENT_INTEGER + 1 + fraction] for slope in (gx, gy))
        return values | {"e": e[: EXPONENT_INTEGER + 1 + fraction], "gx": gx, "gy": gy, "far": far}
