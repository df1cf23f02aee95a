"""The codebooks on chip: sums of the entries that a Gaussian's indices select.

Models in steps need no codebooks: their harmonics are stored in the same memory.
"""

from collections.abc import Callable

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout
from splatcore.hdl.points.state import ModelState
from splatcore.spec.colour import BASE, CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.memory import (
    ATTRIBUTE_BITS,
    CODEBOOK_WORD,
    COLOUR_ENTRY,
    COMPONENT,
    SH_ENTRY,
    SLOPE,
    ModelFormat,
    compact_degrees,
    model_format,
    step_format,
)
from splatcore.spec.number import Fixed
from splatcore.spec.programs import SLOPES

FACTOR_BITS = model_format(Config(), 0).attribute_record.offset("colour0")
"""Bits of the first beat of attributes below the colour: L and opacity."""

INDEX_BITS = ATTRIBUTE_BITS - FACTOR_BITS

LANE_BITS = exact_log2(CODEBOOK_WORD // COLOUR_ENTRY.size)
"""Bits of a colour entry's index within its word."""

FIRST_WORD = 2
"""Cycles from an item's start to its first word: one to take its indices, one to read."""


def sum_of(entry: Fixed, stages: int) -> Fixed:
    """Format of a sum of one entry from each stage; it never overflows."""
    steps = range(stages * int(entry.min), stages * int(entry.max) + 1)
    return Fixed(Shape.cast(steps).width - 1, 0, signed=True)


def codebook_line(config: Config) -> data.StructLayout:
    """A word of the memory, and its address."""
    words = range(config.codebook // CODEBOOK_WORD)
    return data.StructLayout({"address": words, "word": CODEBOOK_WORD * 8})


class Codebook(wiring.Component):
    """Looks up colours and harmonics (the matrix G of `spec.memory`) of Gaussians.

    The memory holds both codebooks as they are in DRAM. Each cycle reads the entry of one stage,
    colour stages first. If colours are not made in the array (`Config.colours`), the memory also
    holds beats of harmonics of models in steps.

    **Timing**: one item every `interval` cycles (`DEFAULT`: 4), `latency` 6. No multiplier.
    """

    def __init__(self, config: Config):
        self.config, self.beside = config, config.colours == "beside"
        self.formats = [model_format(config, degree) for degree in compact_degrees(config)]
        self.words = config.codebook // CODEBOOK_WORD
        for format in self.formats:
            parts = format.layout(0)
            if parts.end - parts.colours > config.codebook:
                raise ValueError(f"preset {config.name}: codebook is too small for {format}")
        stages = dict.fromkeys(name for format in self.formats for name in format.codebook_words)
        self.colour_stages = [name for name in stages if name.startswith("colour")]
        self.sh_stages = [name for name in stages if name.startswith("sh")]
        self.reads = [*self.colour_stages, *self.sh_stages]
        self.latency = FIRST_WORD + len(self.reads)
        self.interval = len(self.reads)
        line = codebook_line(config)
        colour = sum_of(COMPONENT, len(self.colour_stages)).width
        ports = {
            # Always ready; Amaranth cannot convert a component with a port that says so.
            "write": In(stream.Signature(line)),
            "start": In(1),  # an item begins; at least `interval` cycles after the previous one
            # bits of its attributes from `FACTOR_BITS` on, read in that cycle and the next two
            "index": In(INDEX_BITS),
            "model": In(ModelState),
            # integers, sums of the colour entries `latency` cycles after the start, for one cycle;
            # longer if items are farther apart than `interval`; without codebooks the item's base
            # in steps
            "colour": Out(data.ArrayLayout(signed(colour), len(CHANNELS))),
        }
        if self.sh_stages:
            slope = signed(sum_of(SLOPE, len(self.sh_stages)).width)
            # sums of the elements of G, row by row, held for one cycle longer than `colour`; valid
            # if the model has harmonics
            ports["g"] = Out(data.ArrayLayout(slope, len(SLOPES)))
        if self.beside:
            reading = data.StructLayout({"enable": 1, "address": range(self.words)})
            # as `write`, never in the same cycle
            ports["beat"] = In(data.StructLayout({"valid": 1} | line.members))
            ports["read"] = In(reading)  # of a word, for models without codebooks
            ports["word"] = Out(CODEBOOK_WORD * 8)  # read one cycle before, or earlier
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        self.time = [self.start]  # k cycles after an item's start
        for k in range(1, self.latency):
            self.time.append(Signal(name=f"time{k}"))
            m.d.sync += self.time[k].eq(self.time[k - 1])
        word, lane = self._read(m)
        self._colour(m, word, lane)
        if self.sh_stages:
            self._slopes(m, word)
        return m

    def _of_model(self, number: Callable[[ModelFormat], int]) -> Value:
        """A number that depends on the model's degree."""
        plain, *shaded = [number(format) for format in self.formats]
        return Mux(self.model.sh, *shaded, plain) if shaded else Const(plain)

    def _has(self, name: str) -> Value:
        """High if the model has a stage."""
        return self._of_model(lambda format: name in format.codebook_words)

    def _word_of(self, name: str) -> Value:
        """`time` in which a stage's word has been read."""
        return self.time[FIRST_WORD + self.reads.index(name)]

    def _index(self, name: str) -> Value:
        """An item's index of a stage; models without harmonics have it at another offset."""
        records = [format.attribute_record for format in self.formats]
        fields = [
            self.index[record.offset(name) - FACTOR_BITS :][: record[name].width]
            for record in records
            if name in dict(record.fields)
        ]
        return Mux(self.model.sh, fields[1], fields[0]) if len(fields) == 2 else Cat(fields)

    def _read(self, m: Module) -> tuple[Value, Value]:
        """The memory: one word per cycle, and the index of the colour entry within it."""
        m.submodules.memory = memory = Memory(shape=CODEBOOK_WORD * 8, depth=self.words, init=[])
        write, read = memory.write_port(), memory.read_port()
        source, enable = self.write.payload, self.write.valid
        m.d.comb += self.write.ready.eq(1)
        if self.beside:
            m.d.comb += [
                write.addr.eq(Mux(enable, source.address, self.beat.address)),
                write.data.eq(Mux(enable, source.word, self.beat.word)),
                write.en.eq(enable | self.beat.valid),
            ]
        else:
            m.d.comb += [write.addr.eq(source.address), write.data.eq(source.word)]
            m.d.comb += write.en.eq(enable)
        # A shift register of indices, counted in colour entries, ends at the address.
        entries = [Signal(range(self.words << LANE_BITS), reset_less=True) for _ in self.reads]
        for k, name in enumerate(self.reads):
            index = self._index(name)
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
        address = base + entries[0][LANE_BITS:]
        if self.beside:
            address = Mux(self.model.codebooks, address, self.read.address)
            enable = Mux(self.model.codebooks, enable, self.read.enable)
            m.d.comb += self.word.eq(read.data)
        m.d.comb += [read.addr.eq(address), read.en.eq(enable)]
        return read.data, lane

    def _colour(self, m: Module, word: Value, lane: Value):
        """The sums of the colour entries, or the base."""
        entries = data.ArrayLayout(layout(COLOUR_ENTRY), CODEBOOK_WORD // COLOUR_ENTRY.size)
        rgb = data.View(entries, word)[lane].rgb
        first, *_ = self.colour_stages
        given = Cat(self._word_of(name) & self._has(name) for name in self.colour_stages).any()
        record = step_format(self.config, 0).attribute_record
        for k, channel in enumerate(CHANNELS):
            total, entry = self.colour[k], rgb[k].as_signed()
            if len(self.colour_stages) > 1:
                entry = Mux(self._word_of(first), 0, total) + entry
            if self.beside:
                base = self.index[record.offset(channel) - FACTOR_BITS :][: BASE.width]
                entry = Mux(self.model.codebooks, entry, base.as_signed())
                given = Mux(self.model.codebooks, given, self._word_of(first))
            with m.If(given):
                m.d.sync += total.eq(entry)

    def _slopes(self, m: Module, word: Value):
        """The sums of the SH entries."""
        g = data.View(layout(SH_ENTRY), word).g
        first, *rest = [self._word_of(name) for name in self.sh_stages]
        for k in range(len(SLOPES)):
            entry = g[k].as_signed()
            with m.If(Cat(first, *rest).any()):
                m.d.sync += self.g[k].eq((Mux(first, 0, self.g[k]) if rest else 0) + entry)
