"""Reads and checks a model's header and loads its codebooks, before a frame's points."""

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.spec import memory
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, DATA_BITS, range_record
from splatcore.spec.config import Config
from splatcore.spec.point import EXPONENT, GAUSSIAN_BITS
from splatcore.spec.registers import CODE_BITS, ErrorCode

EXPONENTS = ("position_exponent", "colour_exponent", "sh_exponent")

RANGE_BITS = 10  # width of the number of beats of a read: a header, or all codebooks


class Load(wiring.Component):
    """Reads a model's header, checks that this machine can render it, and loads its codebooks.

    Members
        start: begin. model: address of the model in beats; it stays until `loaded`.
        ranges: stream of `range_record` to be read; beats: stream of these.
        write: the codebook memory's words.
        gaussians, sh, position_exponent, colour_exponent, sh_exponent: what the header says.
        positions, attributes: addresses of these parts in beats.
        loaded: header and codebooks have been read, until the next start.
        error: `ErrorCode`, not NONE: the header does not fit; nothing more happens.

    **Timing**: a beat a cycle; a header of 4 beats and up to 512 of codebooks for each frame.
    """

    def __init__(self, config: Config):
        self.config = config
        self.formats = [
            memory.model_format(config, degree) for degree in range(config.sh_degree + 1)
        ]
        self.words = [
            (format.layout(0).end - format.layout(0).colours) // memory.CODEBOOK_WORD
            for format in self.formats
        ]
        line = {"address": range(config.codebook // memory.CODEBOOK_WORD), "word": DATA_BITS}
        ports = {
            "start": In(1),
            "model": In(BEAT_ADDRESS_BITS),
            "ranges": Out(stream.Signature(layout(range_record(RANGE_BITS)))),
            "beats": In(stream.Signature(DATA_BITS)),
            "write": Out(stream.Signature(data.StructLayout(line))),
            "gaussians": Out(GAUSSIAN_BITS),
            "sh": Out(1),
            "positions": Out(BEAT_ADDRESS_BITS),
            "attributes": Out(BEAT_ADDRESS_BITS),
            "loaded": Out(1),
            "error": Out(CODE_BITS),
        }
        ports |= {name: Out(signed(EXPONENT.width)) for name in EXPONENTS}
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        number = Signal(range(max(memory.HEADER.size // BEAT, *self.words) + 1))
        m.d.comb += self.write.payload.address.eq(number)
        m.d.comb += self.write.payload.word.eq(self.beats.payload)
        colours = Signal(memory.HEADER["colours"].width)
        header, codebooks = Signal(), Signal()  # beats are of the one or the other
        wrong = self._header(m, number, colours, header)
        words = Array(self.words)[self.sh]
        ranges, asked = self.ranges.payload, self.ranges.valid & self.ranges.ready
        last = number == Mux(header, memory.HEADER.size // BEAT, words) - 1
        m.d.comb += self.beats.ready.eq(header | codebooks)
        m.d.comb += [self.write.valid.eq(codebooks & self.beats.valid), ranges.beat.eq(self.model)]
        m.d.comb += ranges.count.eq(memory.HEADER.size // BEAT)
        with m.If(self.beats.valid & self.beats.ready):
            m.d.sync += number.eq(Mux(last, 0, number + 1))
        through = self.beats.valid & last
        with m.FSM():
            with m.State("IDLE"), m.If(self.start):
                m.d.sync += [self.loaded.eq(0), self.error.eq(ErrorCode.NONE)]
                m.next = "ASK"
            with m.State("ASK"):
                m.d.comb += self.ranges.valid.eq(1)
                with m.If(asked):
                    m.next = "HEADER"
            with m.State("HEADER"):
                m.d.comb += header.eq(1)
                with m.If(self.beats.valid & (self.error == ErrorCode.NONE)):
                    m.d.sync += self.error.eq(wrong)
                with m.If(through):
                    m.next = "CHECKED"
            with m.State("CHECKED"):
                m.d.comb += self.ranges.valid.eq(self.error == ErrorCode.NONE)
                m.d.comb += [ranges.beat.eq(self._address(colours)), ranges.count.eq(words)]
                with m.If(asked):
                    m.next = "CODEBOOKS"
                with m.Elif(self.error != ErrorCode.NONE):
                    m.next = "IDLE"
            with m.State("CODEBOOKS"):
                m.d.comb += codebooks.eq(1)
                with m.If(through):
                    m.d.sync += self.loaded.eq(1)
                    m.next = "IDLE"
        return m

    def _address(self, part: Value) -> Value:
        """The address in beats at which a part of the model begins."""
        return self.model + part * (memory.ALIGNMENT // BEAT)

    def _header(self, m: Module, number: Value, colours: Signal, header: Value) -> Value:
        """Keep the fields in the header's beat `number`; the error in it, NONE if there is none."""
        offsets = memory.HEADER.offsets

        def field(name: str) -> Value:
            return self.beats.payload[offsets[name] % DATA_BITS :][: memory.HEADER[name].width]

        def in_beat(name: str) -> Value:
            return number == offsets[name] // DATA_BITS

        positions, attributes = Signal.like(colours), Signal.like(colours)
        kept = {"count": self.gaussians, "sh_degree": self.sh, "colours": colours}
        kept |= {"positions": positions, "attributes": attributes}
        kept |= {name: getattr(self, name) for name in EXPONENTS}
        with m.If(header & self.beats.valid):
            for name, target in kept.items():
                with m.If(in_beat(name)):
                    m.d.sync += target.eq(field(name))
        m.d.comb += self.positions.eq(self._address(positions))
        m.d.comb += self.attributes.eq(self._address(attributes))
        fits = {
            "position": field("position") == memory.POSITION_FORMATS.index(self.config.position),
            "sh_degree": field("sh_degree") <= self.config.sh_degree,
        }
        for name in EXPONENTS:
            value = field(name).as_signed()
            fits[name] = (value <= memory.EXPONENT_MAX) & (value >= -memory.EXPONENT_MAX)
        for part in ("colour_index", "sh_index"):
            stages = memory.HEADER[part].length
            bits = [getattr(format, part) for format in self.formats]
            codes = [Cat(Const(k, 8) for k in b + (0,) * (stages - len(b))) for b in bits]
            fits[part] = field(part) == Mux(self.sh, codes[-1], codes[0])
        unfit = Cat(in_beat(name) & ~fit for name, fit in fits.items()).any()
        return Mux(
            in_beat("magic") & (field("magic") != memory.MAGIC),
            ErrorCode.MAGIC,
            Mux(
                in_beat("version") & (field("version") != memory.VERSION),
                ErrorCode.VERSION,
                Mux(unfit, ErrorCode.FORMAT, ErrorCode.NONE),
            ),
        )
