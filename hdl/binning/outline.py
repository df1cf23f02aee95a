"""Binning, first step: converts a splat's floats to the integers of its outline and tile rows."""

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import bits_for

from splatcore.hdl.arithmetic.float import Unpack
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.shift import leading_zeros
from splatcore.spec.binning import (
    FACTOR_FRACTION,
    FINEST,
    HALF_BITS,
    LENGTH_BITS,
    STEP_MAX,
    TILE_BITS,
    position_bits,
    slack,
)
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.point import splat_record

PHASES = 3  # cycles for a splat

NUMBERS = ("half_width", "half_height", "u", "v", "lean", "shear", "slope")
SHIFTERS = (("half_width", "u", "slope"), ("half_height", "v", "shear"), (None, "lean", None))
"""Numbers of an outline; and for each shifter, the number it shifts in each phase."""

SQUARE_NUMBERS = ("radius", "u", "v")
SQUARE_SHIFTERS = (("radius", "u", None), (None, "v", None))  # the same for a square

SHIFTED_BITS = (LENGTH_BITS, None, FACTOR_FRACTION + 1)
"""Bits of the shifted number in each phase; None: `position_bits`, for a centre."""


def outline_layout(config: Config) -> data.StructLayout:
    """A splat's outline in its units, and its first and last tile row.

    between: it touches no pixels of any row. The rows of a square all have the same columns, so
        they
    need only a few of the fields.
    """
    position, row = signed(position_bits(config) + 1), range(-(-config.side_max // TILE))
    fields = {"first": row, "last": row, "between": 1, "normalise": range(HALF_BITS)}
    for name in "xy":
        fields |= {
            f"centre_{name}": position,
            f"half_{name}": HALF_BITS,
            f"limit_{name}": position_bits(config),
            f"shift_{name}": range(STEP_MAX + 1),  # log2 of a tile's units
            f"vast_{name}": 1,
        }
    if config.tile_test == "3sigma":
        names = [name for name in fields if not name.endswith(("_y", "normalise"))]
        return data.StructLayout({name: fields[name] for name in names})
    factors = {
        "lean": signed(HALF_BITS + 1),
        "shear": signed(FACTOR_FRACTION + 2),
        "slope": FACTOR_FRACTION + 2,
    }
    return data.StructLayout(fields | factors)


def pixel(shift: Value) -> Value:
    """A pixel in units, from log2 of a tile in units; 0 if the unit is coarser than pixels."""
    return (Const(1, 1) << shift)[TILE_BITS:]


class Outline(wiring.Component):
    """Computes the outlines of the splats whose box touches the image.

    **Timing**: one splat every three cycles, latency 3; no multiplier. Three shifters for a splat's
    seven numbers: first widths and heights, then numbers that depend on their units, then those
    that depend on the normalised height; two shifters for a square's three numbers. The input is
    held until all are done.
    """

    def __init__(self, config: Config):
        self.config, self.format = config, config.arithmetic
        self.square = config.tile_test == "3sigma"
        self.bits = position_bits(config)
        widest = max(self.bits, FACTOR_FRACTION + 1)
        self.before = max(0, widest - self.format.fraction - 1)
        ports = {
            "i": In(stream_of(splat_record(config))),
            "width": In(range(config.side_max + 1)),  # of the image, pixels
            "height": In(range(config.side_max + 1)),  # of the image, pixels
            "room": In(1),  # a splat may be taken
            "seen": Out(1),  # the splat that is being taken will have an outline
            "o": Out(stream.Signature(outline_layout(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        phase, step, enable = Signal(PHASES, init=1), Signal(), Signal()
        names = SQUARE_NUMBERS if self.square else NUMBERS
        self.parts = {}
        for name in names:
            m.submodules[f"unpack_{name}"] = unpack = Unpack(self.format)
            m.d.comb += unpack.i.eq(self.i.payload[name])
            self.parts[name] = unpack.o
        self.held = Signal(outline_layout(self.config), reset_less=True)
        self._registers()
        names = SQUARE_SHIFTERS if self.square else SHIFTERS
        x, y = self._shifter(m, phase, "x", names[0]), self._shifter(m, phase, "y", names[1])
        lean = None if self.square else self._shifter(m, phase, "y", names[2])

        m.d.comb += enable.eq(~self.o.valid | self.o.ready)
        m.d.comb += step.eq(self.i.valid & enable & (~phase[-1] | self.room))
        m.d.comb += self.i.ready.eq(phase[-1] & enable & self.room)
        with m.If(enable):
            m.d.sync += self.o.valid.eq(step & phase[-1] & self.seen)
        with m.If(step):
            m.d.sync += phase.eq(phase.rotate_left(1))
            with m.If(phase[0]):
                self._length(m, "x", x.number, names[0][0])
                if not self.square:
                    self._length(m, "y", y.number, names[1][0])
            with m.If(phase[1]):
                self._centre(m, "x", x.number, "u", self.width)
                self._centre(m, "y", y.number, "v", self.height)
                if not self.square:
                    self._normalise(m, lean.number)
            with m.If(phase[2]):
                if not self.square:
                    self._factors(m, x.number, y.number)
        self._box(m, step & phase[1], {"x": x.fits, "y": y.fits}, step & phase[2])
        return m

    def _registers(self):
        """Registers of each axis' numbers.

        A square has the same length along both axes, and its rows need no numbers of y: these are
        kept outside the outline.
        """
        held, lengths = self.held, ("half", "shift", "vast")
        self.known = {name: held[name] for name in held.shape().members}
        self.step = {axis: Signal(range(STEP_MAX + 1), name=f"step_{axis}") for axis in "xy"}
        if self.square:
            self.step["y"] = self.step["x"]
            self.known |= {f"{name}_y": held[f"{name}_x"] for name in lengths}
            for name in ("centre", "limit"):
                shape = held[f"{name}_x"].shape()
                self.known[f"{name}_y"] = Signal(shape, name=f"{name}_y", reset_less=True)
        else:
            self.finer = Signal(Shape.cast(range(-STEP_MAX, STEP_MAX + HALF_BITS + 1)))

    def _shifter(self, m: Module, phase: Signal, axis: str, names: tuple) -> data.View:
        """⌊value · 2^power⌋ of the number selected in each phase, and whether it fits.

        For lengths and positions the power is given by the axis' unit; a ratio is scaled to its own
        normalised units. A position that does not fit gives 0, a lean or a ratio the maximum.
        """
        format = self.format
        top = format.fraction + self.before
        unit = top + format.bias - self.config.screen_exponent - FINEST
        result = Signal(data.StructLayout({"number": self.bits, "fits": 1}), name=f"shifted_{axis}")
        amount = Signal(signed(format.exponent + 4))
        significand, full = Signal(format.fraction + 1), Signal(self.bits)
        for k, name in enumerate(names):
            if name is None:
                continue
            exponent = self.parts[name].exponent
            bits = HALF_BITS if name == "lean" else SHIFTED_BITS[k] or self.bits
            with m.If(phase[k]):
                if k == 0:  # with any unit except the finest, this leaves LENGTH_BITS
                    least = top - LENGTH_BITS + 1
                    m.d.comb += amount.eq(Mux(exponent > unit - least, least, unit - exponent))
                elif k == 1:
                    m.d.comb += amount.eq(unit - exponent + self.step[axis])
                else:
                    ratio = top + format.bias - FACTOR_FRACTION
                    m.d.comb += amount.eq(ratio - exponent + self.finer)
                m.d.comb += significand.eq(self.parts[name].significand)
                m.d.comb += result.fits.eq(amount > top - bits)
                m.d.comb += full.eq((1 << bits) - 1 if name in ("lean", "shear", "slope") else 0)
        width = top + 1
        shifted = Cat(Const(0, self.before), significand) >> amount[: bits_for(width - 1)]
        shifted = Mux(amount >= width, 0, shifted)
        m.d.comb += result.number.eq(Mux(result.fits, shifted, full))
        return result

    def _length(self, m: Module, axis: str, number: Value, name: str):
        """The unit that follows from a length, and the length in that unit."""
        format, held = self.format, self.held
        offset = self.config.screen_exponent + FINEST + 1 - LENGTH_BITS - format.bias
        found = Signal(signed(format.exponent + 2), name=f"found_{axis}")
        vast = found > STEP_MAX
        m.d.comb += found.eq(self.parts[name].exponent + offset)
        m.d.sync += [
            self.step[axis].eq(Mux(found < 0, 0, Mux(vast, STEP_MAX, found))),
            held[f"vast_{axis}"].eq(vast),
            held[f"half_{axis}"].eq(Mux(vast, 0, number[:LENGTH_BITS]) + 1 + slack(self.config)),
        ]

    def _centre(self, m: Module, axis: str, number: Value, name: str, size: Value):
        """Numbers in a known unit: the centre, the image's last pixel, a tile."""
        held, step = self.known, self.step[axis]
        centre = Cat(number, Const(0, 1)).as_signed()
        last = Cat(Const(0, FINEST), size - 1)[: len(size) + FINEST]
        m.d.sync += held[f"centre_{axis}"].eq(Mux(self.parts[name].sign, ~centre, centre))
        m.d.sync += held[f"limit_{axis}"].eq((last >> step) + (step > FINEST))
        m.d.sync += held[f"shift_{axis}"].eq(STEP_MAX - step)

    def _factors(self, m: Module, slope: Value, shear: Value):
        """The ratios of an outline."""
        shear = Cat(shear, 0)[: FACTOR_FRACTION + 2].as_signed()
        m.d.sync += self.held.slope.eq(slope + 1)
        m.d.sync += self.held.shear.eq(Mux(self.parts["shear"].sign, -shear, shear))

    def _normalise(self, m: Module, lean: Value):
        """Shift between the horizontal unit and the finer unit of a normalised height."""
        normalise = leading_zeros(m, self.held.half_y)
        lean = Cat(lean[:HALF_BITS], Const(0, 1)).as_signed()
        m.d.sync += self.held.lean.eq(Mux(self.parts["lean"].sign, -lean, lean))
        m.d.sync += self.held.normalise.eq(normalise)
        m.d.sync += self.finer.eq(self.step["x"] + normalise - self.step["y"])

    def _box(self, m: Module, centred: Value, near: dict[str, Value], last: Value):
        """The rows of tiles that the box covers, and `seen` if it meets the image."""
        held, seen, ends = self.known, Const(1, 1), {}
        for axis in "xy":
            is_near = Signal(name=f"near_{axis}")
            with m.If(centred):
                m.d.sync += is_near.eq(near[axis])
            half, centre = held[f"half_{axis}"], held[f"centre_{axis}"]
            low, high = centre - half, centre + half + 1
            inside = is_near & (low <= held[f"limit_{axis}"]) & (high >= 0)
            seen &= inside | held[f"vast_{axis}"]
            if axis == "y":
                for name, value in ("low", low + pixel(held["shift_y"]) - 1), ("high", high):
                    ends[name] = Signal(value.shape(), name=name, reset_less=True)
                    with m.If(last):
                        m.d.sync += ends[name].eq(value)
        shift, vast = held["shift_y"], held["vast_y"]
        first, end = ends["low"] >> shift, ends["high"] >> shift
        bottom, o = Signal.like(self.held.last), self.o.payload
        between = (first > end) & ~vast  # pixels of two rows
        if self.config.compensates:  # opacities below 1/255 have no extent
            seen &= ~self.i.payload.half_width[-1]
        m.d.comb += [
            self.seen.eq(seen),
            bottom.eq((self.height - 1) >> TILE_BITS),
            o.eq(self.held),
            o.first.eq(Mux((first < 0) | vast, 0, first)),
            o.last.eq(Mux((end > bottom) | vast, bottom, Mux(between, first, end))),
            o.between.eq(between),
        ]
