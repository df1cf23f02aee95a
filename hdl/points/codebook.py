"""The codebooks on chip: a Gaussian's indices to its colour and harmonics, as floats."""

from collections.abc import Callable

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.arithmetic.convert import FromFixed
from splatcore.hdl.lib.record import layout
from splatcore.hdl.points.array import codes
from splatcore.spec.config import Config
from splatcore.spec.memory import (
    CODEBOOK_WORD,
    COLOUR_ENTRY,
    COMPONENT,
    EXPONENT_MAX,
    SH_ENTRY,
    SLOPE,
    ModelFormat,
    model_format,
)
from splatcore.spec.number import Fixed
from splatcore.spec.programs import COLOURS, SLOPES

LANES = len(COLOURS)  # numbers that are converted at a time: the colour, or a row of G

ROWS = len(SLOPES) // LANES

LANE_BITS = exact_log2(CODEBOOK_WORD // COLOUR_ENTRY.size)
"""Bits of a colour entry's index within its word."""

FIRST_WORD = 2
"""Cycles from an item's start to its first word: one to take its indices, one to read."""

CONVERT = 1  # cycles of the converters


def sum_of(entry: Fixed, stages: int) -> Fixed:
    """The format of a sum of one entry from each stage: it never overflows."""
    steps = range(stages * int(entry.min), stages * int(entry.max) + 1)
    return Fixed(Shape.cast(steps).width - 1, 0, signed=True)


class Codebook(wiring.Component):
    """Looks up colours and harmonics (the matrix G of `spec.memory`) of Gaussians.

    The memory holds both codebooks as they lie in DRAM. Each cycle reads the entry of one stage;
    the sum over the stages, exact in integers, is converted with the model's exponent and rounded
    once, first G row by row, then the colour.

    Members
        write: stream of words of the memory with their addresses, always taken.
        start: an item begins; not before `interval` cycles after the one before it.
        index: its indices, taken in that cycle.
        sh: whether the model has harmonics; without them all of G is zero.
        colour_exponent, sh_exponent: those of the model's header. All three stay as they are from
            an item's start until its values come.
        o: the values as floats of `Config.arithmetic`, of an item for one cycle.

    A machine for models without harmonics has no `sh`, no `sh_exponent` and no G.

    **Timing**: an item every `interval` cycles (`DEFAULT` 4, one for each stage); its values are at
    `o` exactly `latency` cycles after its start (8). No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        self.formats = [model_format(config, degree) for degree in range(config.sh_degree + 1)]
        self.words = config.codebook // CODEBOOK_WORD
        for format in self.formats:
            parts = format.layout(0)
            if parts.end - parts.colours > config.codebook:
                raise ValueError(f"preset {config.name}: codebook is too small for {format}")
        stages = dict.fromkeys(name for format in self.formats for name in format.codebook_words)
        self.colour_stages = [name for name in stages if name.startswith("colour")]
        self.sh_stages = [name for name in stages if name.startswith("sh")]
        # G comes first and is converted while colour stages are read, the last ones if many.
        early, late = self.colour_stages[:-ROWS], self.colour_stages[-ROWS:]
        self.reads = [*early, *self.sh_stages, *late] if self.sh_stages else self.colour_stages

        records = [dict(format.attribute_record.fields) for format in self.formats]
        index = {  # of any model
            name: max(record[name].width for record in records if name in record) for name in stages
        }
        exponent = range(-EXPONENT_MAX, EXPONENT_MAX + 1)
        line = data.StructLayout({"address": range(self.words), "word": CODEBOOK_WORD * 8})
        ports = {
            # Always ready; Amaranth cannot convert a component with a port that says so.
            "write": In(stream.Signature(line)),
            "start": In(1),
            "index": In(data.StructLayout(index)),
            "colour_exponent": In(exponent),
            "o": Out(codes(config, COLOURS + (SLOPES if self.sh_stages else ()))),
        }
        if self.sh_stages:
            ports |= {"sh": In(1), "sh_exponent": In(exponent)}
        super().__init__(ports)

    @property
    def interval(self) -> int:
        """Least number of cycles from one item's start to the next."""
        if not self.sh_stages:
            return len(self.reads)
        # Sums of G give way to those of the next item, and the converters have to serve all rows.
        return max(len(self.reads), len(self.sh_stages) + ROWS - 1, ROWS + 1)

    @property
    def latency(self) -> int:
        """Cycles from an item's start to its values."""
        return self._converted + CONVERT

    @property
    def _converted(self) -> int:
        """Cycles from an item's start until its colour goes into the converters."""
        if not self.sh_stages:
            return FIRST_WORD + len(self.reads)
        return FIRST_WORD + self.reads.index(self.sh_stages[-1]) + 1 + ROWS

    def elaborate(self, platform) -> Module:
        m = Module()
        self.time = [self.start]  # k cycles after an item's start
        for k in range(1, self._converted + 1):
            self.time.append(Signal(name=f"time{k}"))
            m.d.sync += self.time[k].eq(self.time[k - 1])
        word, lane = self._read(m)
        numbers, exponent = self._colour(m, word, lane), self.colour_exponent
        if self.sh_stages:
            last, rows = self.time[self._converted], self._slopes(m, word)
            exponent = Mux(self.time[self._converted - 1], exponent, self.sh_exponent)
            pairs = zip(numbers, rows, strict=True)
            numbers = [Mux(last, colour, Mux(self.sh, slope, 0)) for colour, slope in pairs]
        values = self._converted_by(m, numbers, exponent)
        m.d.comb += [self.o[name].eq(value) for name, value in zip(COLOURS, values, strict=True)]
        if self.sh_stages:
            self._gather(m, values)
        return m

    def _of_model(self, number: Callable[[ModelFormat], int]) -> Value:
        """A number that depends on the model's degree."""
        plain, *shaded = [number(format) for format in self.formats]
        return Mux(self.sh, *shaded, plain) if shaded else Const(plain)

    def _has(self, name: str) -> Value:
        """High if the model has a stage."""
        return self._of_model(lambda format: name in format.codebook_words)

    def _word_of(self, name: str) -> Value:
        """`time` in which a stage's word has been read."""
        return self.time[FIRST_WORD + self.reads.index(name)]

    def _read(self, m: Module) -> tuple[Value, Value]:
        """The memory: a word a cycle, and the index of the colour entry within it."""
        m.submodules.memory = memory = Memory(shape=CODEBOOK_WORD * 8, depth=self.words, init=[])
        write, read = memory.write_port(), memory.read_port()
        m.d.comb += [self.write.ready.eq(1), write.en.eq(self.write.valid)]
        m.d.comb += write.addr.eq(self.write.payload.address)
        m.d.comb += write.data.eq(self.write.payload.word)
        # Indices wait in line for the address, counted in colour entries.
        entries = [Signal(range(self.words << LANE_BITS), reset_less=True) for _ in self.reads]
        for k, name in enumerate(self.reads):
            index = self.index[name]
            entry = Cat(Const(0, LANE_BITS), index) if name in self.sh_stages else index
            behind = entries[k + 1] if k + 1 < len(entries) else entry
            m.d.sync += entries[k].eq(Mux(self.start, entry, behind))
        lane = Signal(LANE_BITS, reset_less=True)
        m.d.sync += lane.eq(entries[0])
        base, enable = Const(0), Const(0)
        for k, name in enumerate(self.reads, 1):
            begin = self._of_model(lambda format, name=name: format.codebook_words.get(name, 0))
            base |= Mux(self.time[k], begin, 0)
            enable |= self.time[k] & self._has(name)
        m.d.comb += [read.addr.eq(base + entries[0][LANE_BITS:]), read.en.eq(enable)]
        return read.data, lane

    def _colour(self, m: Module, word: Value, lane: Value) -> list[Value]:
        """The sums of the colour entries."""
        entries = data.ArrayLayout(layout(COLOUR_ENTRY), CODEBOOK_WORD // COLOUR_ENTRY.size)
        rgb = data.View(entries, word)[lane].rgb
        first, *_ = self.colour_stages
        given = Const(0)
        for name in self.colour_stages:
            given |= self._word_of(name) & self._has(name)
        shape = signed(sum_of(COMPONENT, len(self.colour_stages)).width)
        sums = [Signal(shape, name=name, reset_less=True) for name in COLOURS]
        for k, total in enumerate(sums):
            entry = rgb[k].as_signed()
            if len(self.colour_stages) == 1:
                with m.If(given):
                    m.d.sync += total.eq(entry)
            else:
                before = Mux(self._word_of(first), 0, total)
                m.d.sync += total.eq(before + Mux(given, entry, 0))
        return sums

    def _slopes(self, m: Module, word: Value) -> list[Value]:
        """The sums of the SH entries: a row of G, in the cycle after the last and those behind."""
        g = data.View(layout(SH_ENTRY), word).g
        first, *rest = [self._word_of(name) for name in self.sh_stages]
        later = Cat(rest).any()
        shape = signed(sum_of(SLOPE, len(self.sh_stages)).width)
        sums = [Signal(shape, name=name, reset_less=True) for name in SLOPES]
        for k, total in enumerate(sums):
            entry = g[k].as_signed()
            value = Mux(later, total, 0) + entry if rest else entry
            # The last row may go once the row before it has taken its value over.
            next_row = sums[k + LANES] if k + LANES < len(sums) else value
            m.d.sync += total.eq(Mux(first | later, value, next_row))
        return sums[:LANES]

    def _converted_by(self, m: Module, numbers: list[Value], exponent: Value) -> list[Value]:
        """Floats of integers · 2^exponent."""
        formats = [sum_of(COMPONENT, len(self.colour_stages))]
        if self.sh_stages:
            formats.append(sum_of(SLOPE, len(self.sh_stages)))
        fixed = max(formats, key=lambda format: format.width)
        scales = FromFixed.scales(fixed, self.config.arithmetic)
        scale = Signal(Shape.cast(scales), reset_less=True)
        m.d.sync += scale.eq(exponent)
        with m.If(exponent < scales[0]):
            m.d.sync += scale.eq(scales[0])
        with m.Elif(exponent > scales[-1]):
            m.d.sync += scale.eq(scales[-1])
        floats = []
        for name, number in zip(COLOURS, numbers, strict=True):
            converter = FromFixed(fixed, self.config.arithmetic, CONVERT, scales)
            m.submodules[f"convert_{name}"] = converter
            m.d.comb += [converter.i.eq(number), converter.scale.eq(scale), converter.enable.eq(1)]
            floats.append(converter.o)
        return floats

    def _gather(self, m: Module, values: list[Value]):
        """Rows of G are shifted along, a register each cycle, until the colour follows them."""
        for lane, value in enumerate(values):
            for row in reversed(range(ROWS)):
                name = SLOPES[row * LANES + lane]
                waiting = Signal(len(value), name=name, reset_less=True)
                m.d.sync += waiting.eq(value)
                m.d.comb += self.o[name].eq(waiting)
                value = waiting
