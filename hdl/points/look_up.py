"""Colours and harmonics from the codebooks as floats, for arrays that compute colours."""

from amaranth.hdl import Module, Mux, Shape, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.convert import FromFixed
from splatcore.hdl.points.codebook import INDEX_BITS, Codebook, codebook_line, sum_of
from splatcore.hdl.points.state import ModelState, codes
from splatcore.spec.colour import EXPONENT_MAX, EXPONENT_MIN
from splatcore.spec.config import Config
from splatcore.spec.memory import COMPONENT, SLOPE
from splatcore.spec.programs import COLOURS, SLOPES

LANES = len(COLOURS)  # numbers that are converted at a time: a row of G, or the colour

ROWS = len(SLOPES) // LANES

CONVERT = 1  # latency of the converters in cycles


class LookUp(wiring.Component):
    """The sums of `hdl.points.codebook` as floats: times 2^E, rounded once.

    First G is converted row by row, then the colour.

    **Timing**: one item every `interval` cycles (`PAPER`: 5); its values are at `o` exactly
    `latency` cycles after its start (8). No multiplier.
    """

    def __init__(self, config: Config):
        self.config, self.codebook = config, Codebook(config)
        self.shaded = bool(self.codebook.sh_stages)
        self.converted = self.codebook.latency + ROWS * self.shaded
        """Cycles from an item's start until its colour goes into the converters."""
        self.latency = self.converted + CONVERT
        # Sums are held until all are converted; the values of the next item come later.
        self.interval = self.codebook.interval + ROWS * self.shaded
        ports = {
            "write": In(stream.Signature(codebook_line(config))),  # words of the codebook memory
            "start": In(1),  # an item begins; at least `interval` cycles after the previous one
            # bits of its attributes from `FACTOR_BITS` on, read in that cycle and the next two
            "index": In(INDEX_BITS),
            "model": In(ModelState),  # without harmonics all of G is zero
            # colour and, if the machine has harmonics, G as floats of `Config.arithmetic`; an
            # item's values are valid for one cycle
            "o": Out(codes(config, COLOURS + (SLOPES if self.shaded else ()))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.codebook = codebook = self.codebook
        connect(m, flipped(self).write, codebook.write)
        m.d.comb += [codebook.start.eq(self.start), codebook.index.eq(self.index)]
        m.d.comb += codebook.model.eq(self.model)
        time = [self.start]  # k cycles after an item's start
        for k in range(1, self.converted):
            time.append(Signal(name=f"time{k}"))
            m.d.sync += time[k].eq(time[k - 1])
        numbers, exponent = list(codebook.colour), self.model.exponent[0]
        if self.shaded:
            colour = Signal()  # goes into the converters
            m.d.sync += colour.eq(time[-1])
            exponent = Mux(time[-1], exponent, self.model.exponent[1])
            for lane, number in enumerate(numbers):
                slope = codebook.g[(ROWS - 1) * LANES + lane]
                for row in range(ROWS - 1):
                    chosen = time[codebook.latency + row]
                    slope = Mux(chosen, codebook.g[row * LANES + lane], slope)
                numbers[lane] = Mux(colour, number, Mux(self.model.sh, slope, 0))
        values = self._converted_by(m, numbers, exponent)
        m.d.comb += [self.o[name].eq(value) for name, value in zip(COLOURS, values, strict=True)]
        if self.shaded:
            self._gather(m, values)
        return m

    def _converted_by(self, m: Module, numbers: list[Value], exponent: Value) -> list[Value]:
        """Floats of integers · 2^exponent."""
        formats = [sum_of(COMPONENT, len(self.codebook.colour_stages))]
        if self.shaded:
            formats.append(sum_of(SLOPE, len(self.codebook.sh_stages)))
        fixed = max(formats, key=lambda format: format.width)
        scales = range(EXPONENT_MIN, EXPONENT_MAX + 1)  # a model beyond these is refused
        scale = Signal(Shape.cast(scales), reset_less=True)
        m.d.sync += scale.eq(exponent)
        floats = []
        for name, number in zip(COLOURS, numbers, strict=True):
            converter = FromFixed(fixed, self.config.arithmetic, CONVERT, scales)
            m.submodules[f"convert_{name}"] = converter
            m.d.comb += [converter.i.eq(number), converter.scale.eq(scale), converter.enable.eq(1)]
            floats.append(converter.o)
        return floats

    def _gather(self, m: Module, values: list[Value]):
        """Shift rows of G along, one register per cycle, until the colour follows them."""
        for lane, value in enumerate(values):
            for row in reversed(range(ROWS)):
                name = SLOPES[row * LANES + lane]
                waiting = Signal(len(value), name=name, reset_less=True)
                m.d.sync += waiting.eq(value)
                m.d.comb += self.o[name].eq(waiting)
                value = waiting
