"""Stage 3, first step: a splat's features to the integers that setup works with."""

from amaranth.hdl import Cat, Const, Module, Mux, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Pipe
from splatcore.spec.config import Config
from splatcore.spec.group import extent_format
from splatcore.spec.number import Fixed, Float
from splatcore.spec.raster import (
    COLOURS,
    EXTENT,
    LEAN_RIGHT_MAX,
    POSITION,
    SCALE_MAX,
    SHEAR,
    SHIFT,
    SHIFT_MIN,
    factor_fraction,
    featured_record,
    lean_unit,
    readied_record,
)

CUTS = ("parts", "shifted", "mixed", "squared", "summed")
"""Registers stand behind what these names say."""


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
    """A significand · 2^−right, floor, as the nearest number of a signed `fixed`.

    A number of `format` fits for certain if it is shifted to the left by no more than `room`; one
    that is shifted farther has its leading one beyond the end.
    """
    bits = fixed.integer + fixed.fraction
    room = bits - format.fraction - 1
    amount, before = right + room, max(room, 0)
    distance = amount if room >= 0 else right  # fewer bits than the significand's: to the right
    shifted = Cat(Const(0, before), value).as_signed() >> _clipped(distance, len(value) + before)
    end = Mux(value[-1], -(1 << bits), (1 << bits) - 1)
    return Mux(amount < 0, end, shifted)[: bits + 1].as_signed()


def _clipped(amount: Value, most: int) -> Value:
    """A shift that does what `amount` ≥ 0 does to a number of `most` bits."""
    width = most.bit_length()
    return Mux(amount[width:-1].any(), (1 << width) - 1, amount[:width])


class Prepare(wiring.Component):
    """Makes of a splat's features a `prepared_record`, by shifts and three products.

    Members
        i: stream of `featured_record`: a splat with the tiles it reaches, or a group's end.
        o: stream of `readied_record`, the same in the integers of setup.

    **Timing**: a splat a cycle, `len(CUTS)` cycles; two multipliers of about 18 × 19 bits.
    """

    def __init__(self, config: Config):
        self.config = config
        self.coarser = factor_fraction(config) - config.exponent_fraction
        ports = {
            "i": In(stream.Signature(layout(featured_record(config)))),
            "o": Out(stream.Signature(layout(readied_record(config)))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pipe = pipe = Pipe(len(CUTS))
        m.d.comb += [pipe.i.valid.eq(self.i.valid), self.i.ready.eq(pipe.i.ready)]
        m.d.comb += [self.o.valid.eq(pipe.o.valid), pipe.o.ready.eq(self.o.ready)]
        self.pipeline = Pipeline(m, pipe.enable, dict.fromkeys(CUTS, 1))
        values = self._cut("parts", self._parts())
        values = self._cut("shifted", self._shifted(values))
        values["mixed"] = (values["across"] * values["slope"]) >> SHEAR.fraction
        values = self._cut("mixed", values)
        right = SHEAR.fraction + self.coarser
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
        format, unit = self.config.arithmetic, self.config.screen_exponent
        i = self.i.payload
        parts = {
            name: Parts(format, i.splat[name]) for name in ("u", "v", "across", "along", "shear")
        }
        one, other = parts["u"].exponent, parts["v"].exponent
        far = Mux(one > other, one, other) + (unit + 1 - POSITION.integer)
        scale = Mux(far < 0, 0, Mux(far > SCALE_MAX, SCALE_MAX, far))
        values = {"scale": scale[: SCALE_MAX.bit_length()], "mask": i.mask, "end": i.end}
        for name in ("u", "v", "shear"):
            values[name] = parts[name].significand
            values[f"{name}_exponent"] = parts[name].exponent
        for name, shift in (("across", "k"), ("along", "m")):
            power = parts[name].exponent - 2 * unit
            magnitude = parts[name].magnitude
            values[shift] = (-((power + 1) >> 1))[: SHIFT.width].as_signed()
            values[name] = Mux(power[0], magnitude, magnitude << 1)
        for name in ("half_width", "half_height"):
            extent = Parts(extent_format(self.config), i.splat[name])
            values |= {name: extent.magnitude, f"{name}_exponent": extent.exponent}
        return values | {name: i.splat[name] for name in ("opacity", *COLOURS)}

    def _shifted(self, values: dict[str, Value]) -> dict[str, Value]:
        """Numbers in the formats of `prepared_record`."""
        format, unit = self.config.arithmetic, self.config.screen_exponent
        done = dict(values)
        for name in ("u", "v"):
            right = values["scale"] - done.pop(f"{name}_exponent")
            right += format.fraction - unit - POSITION.fraction
            done[name] = fitted(values[name], right, format, POSITION)
        exponent, k, along = done.pop("shear_exponent"), values["k"], values["m"]
        right = k - exponent + (format.fraction - SHEAR.fraction)
        done["slope"] = fitted(values["shear"], right, format, SHEAR)
        lean = lean_unit(self.config) - exponent
        lean = Mux(lean < SHIFT_MIN, SHIFT_MIN, Mux(lean > LEAN_RIGHT_MAX, LEAN_RIGHT_MAX, lean))
        shifts = {"k": k, "m": along, "lean_shift": lean}
        shifts |= {"across_shift": k - values["scale"], "along_shift": along - values["scale"]}
        done |= {name: (shift - SHIFT_MIN)[: SHIFT.width] for name, shift in shifts.items()}
        for name in ("half_width", "half_height"):
            done[name] = self._extent(values[name], done.pop(f"{name}_exponent"))
        return done

    def _extent(self, magnitude: Value, exponent: Value) -> Value:
        """Half a width or height in pixels, rounded up: −⌊−x⌋."""
        format = extent_format(self.config)
        right = format.fraction - EXTENT.fraction - self.config.screen_exponent - exponent
        room = EXTENT.width - format.fraction - 1
        less = fitted((-magnitude).as_signed(), right, format, EXTENT)
        return Mux(right < -room, (1 << EXTENT.width) - 1, (-less)[: EXTENT.width])

    def _curvature(self, values: dict[str, Value]) -> dict[str, Value]:
        """E's second differences."""
        coarser = self.coarser
        room = max(2 - coarser, 0)  # k and m are at least −1

        def shifted(value: Value, right: Value) -> Value:
            amount = (right + (coarser + room)).as_signed()
            wide = Cat(Const(0, room), value)
            wide = wide.as_signed() if value.shape().signed else wide
            return wide >> _clipped(amount, len(wide))

        k, m = values["k"] + SHIFT_MIN, values["m"] + SHIFT_MIN
        return {
            "cxx": shifted(values["across"], k << 1),
            "cxy": shifted(values["mixed"], k - 1),
            "cyy": values["squared"] + shifted(values["along"], m << 1),
        }
