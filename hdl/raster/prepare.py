"""Stage 3, first step: converts a splat's features to the integers that setup works with."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Pipe
from splatcore.spec import raster
from splatcore.spec.colour import colour_format
from splatcore.spec.config import Config
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, SHEAR, whole_colours
from splatcore.spec.number import Fixed, Float

CUTS = ("parts", "shifted", "mixed", "squared", "summed")
"""Registers are behind the values with these names."""


class Parts:
    """A float's exponent and signed significand: value = significand · 2^(exponent − fraction)."""

    def __init__(self, format: Float, code: Value):
        biased = code[format.fraction : format.fraction + format.exponent]
        fraction = code[: format.fraction]
        if not format.subnormal:
            fraction &= biased.any().replicate(format.fraction)
        self.exponent = biased + ~biased.any() - format.bias
        self.magnitude = Cat(fraction, biased.any())
        negative = code[-1] if format.signed else Const(0)
        self.significand = Mux(negative, -self.magnitude, self.magnitude)


def fitted(value: Value, right: Value, format: Float, fixed: Fixed) -> Value:
    """A significand · 2^−right, rounded down, as the nearest number of a signed `fixed`.

    A number of `format` fits for certain if it is shifted to the left by at most `room`; if it is
    shifted farther, its leading one is beyond the end.
    """
    bits = fixed.integer + fixed.fraction
    room = bits - format.fraction - 1
    amount, before = right + room, max(room, 0)
    distance = amount if room >= 0 else right  # fewer bits than the significand's: to the right
    shifted = Cat(Const(0, before), value).as_signed() >> _clipped(distance, len(value) + before)
    end = Mux(value[-1], -(1 << bits), (1 << bits) - 1)
    return Mux(amount < 0, end, shifted)[: bits + 1].as_signed()


def _clipped(amount: Value, most: int) -> Value:
    """A shift equivalent to `amount` ≥ 0 for a number of `most` bits."""
    width = most.bit_length()
    return Mux(amount[width:-1].any(), (1 << width) - 1, amount[:width])


class Prepare(wiring.Component):
    """Converts a splat's features to a `readied_record`, by shifts and two products.

    **Timing**: one splat per cycle, latency `len(CUTS)`; two multipliers, of 11 and 18 × 19 bits.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            # a splat with the tiles it reaches, or a group's end
            "i": In(stream_of(raster.featured_record(config))),
            "o": Out(stream_of(raster.readied_record(config))),  # the same in the integers of setup
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pipe = pipe = Pipe(len(CUTS))
        m.d.comb += [pipe.i.valid.eq(self.i.valid), self.i.ready.eq(pipe.i.ready)]
        m.d.comb += [self.o.valid.eq(pipe.o.valid), pipe.o.ready.eq(self.o.ready)]
        self.pipeline = Pipeline(m, pipe.loads, dict.fromkeys(CUTS, 1))
        values = self._cut("parts", self._parts())
        values = self._cut("shifted", self._shifted(values))
        values["mixed"] = (values["across"] * values["slope"]) >> raster.mixed_shift(self.config)
        values = self._cut("mixed", values)
        right = raster.SLOPE.fraction + raster.MIXED_GUARD
        values["squared"] = (values["mixed"] * values["slope"]) >> right
        values = self._cut("squared", values)
        values |= self._curvature(values)
        values = self._cut("summed", values)
        o = self.o.payload
        m.d.comb += [o[name].eq(values[name]) for name in ("mask", "end")]
        m.d.comb += [o.splat[name].eq(values[name]) for name in o.splat.shape().members]
        return m

    def _cut(self, name: str, values: dict[str, Value]) -> dict[str, Value]:
        """All values behind registers."""
        return dict(zip(values, self.pipeline.cut(name, *values.values()), strict=True))

    def _parts(self) -> dict[str, Value]:
        """Exponents and significands, and shifts that follow from exponents alone."""
        i = self.i.payload
        values = {"mask": i.mask, "end": i.end}
        values |= {name: i.splat[name] for name in ("u", "v", "scale", "opacity")}
        for name, shift in (("across", "k"), ("along", "m")):
            factor = Parts(FACTOR, i.splat[name])
            power = factor.exponent - FACTOR_SCALE
            values[shift] = (-((power + 1) >> 1))[: raster.SHIFT.width].as_signed()
            values[name] = Mux(power[0], factor.magnitude, factor.magnitude << 1)
        shear = Parts(SHEAR, i.splat.shear)
        values |= {"shear": shear.significand, "shear_exponent": shear.exponent}
        for name in raster.COLOURS:
            colour = whole_colours(self.config, i.splat[name], Mux)
            values[name] = colour[: colour_format(self.config).width]
        return values

    def _shifted(self, values: dict[str, Value]) -> dict[str, Value]:
        """Numbers in the formats of `prepared_record`."""
        done = dict(values)
        exponent, k, m = done.pop("shear_exponent"), values["k"], values["m"]
        right = k - exponent + (SHEAR.fraction - raster.SLOPE.fraction)
        done["slope"] = fitted(values["shear"], right, SHEAR, raster.SLOPE)
        shifts = {"k": k, "m": m, "lean_shift": raster.lean_unit(self.config) - exponent}
        shifts |= {"across_shift": k - values["scale"], "along_shift": m - values["scale"]}
        return done | {
            name: (shift - raster.SHIFT_MIN)[: raster.SHIFT.width] for name, shift in shifts.items()
        }

    def _curvature(self, values: dict[str, Value]) -> dict[str, Value]:
        """E's second differences."""
        k, m = values["k"] + raster.SHIFT_MIN, values["m"] + raster.SHIFT_MIN
        coarser = raster.FACTOR_FRACTION - self.config.exponent_fraction
        return {
            "cxx": _shifted(values["across"], (k << 1) + coarser, coarser - 2),
            "cxy": _shifted(values["mixed"], k + (raster.MIXED_GUARD - 1), raster.MIXED_GUARD - 2),
            "cyy": values["squared"] + _shifted(values["along"], (m << 1) + coarser, coarser - 2),
        }


def _shifted(value: Value, right: Value, least: int) -> Value:
    """value · 2^−right, rounded down; right is never below `least`."""
    room = max(-least, 0)
    wide = Cat(Const(0, room), value)
    wide = wide.as_signed() if value.shape().signed else wide
    return wide >> _clipped((right + room).as_signed(), len(wide))
