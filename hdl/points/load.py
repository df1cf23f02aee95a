"""Reads and checks a model's header and loads its codebooks, before a frame's points."""

from collections.abc import Callable

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.points.codebook import codebook_line
from splatcore.hdl.points.state import ModelState
from splatcore.spec import memory
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, DATA_BITS, range_record
from splatcore.spec.colour import DEGREES, EXPONENT_MAX, EXPONENT_MIN, SH_EXPONENT_MAX
from splatcore.spec.config import Config
from splatcore.spec.registers import CODE_BITS, DETAIL_BITS, ErrorCode, frame_registers

RANGE_BITS = 10  # width of the number of beats of a read: a header, or all codebooks


class Load(wiring.Component):
    """Reads a model's header, checks that this machine can render the model, and loads its
    codebooks.

    If the parts are in order, end within 4 GiB and have a beat of attributes per Gaussian, nothing
    beyond the model's end is read, except further beats of attributes, which chunk headers ask for:
    positions take less than attributes. Only the host can check the contents, by the checksum.

    **Timing**: one beat per cycle; a header of 4 beats and up to 512 beats of codebooks per frame.
    """

    def __init__(self, config: Config):
        self.config, self.steps = config, config.colours == "beside"
        self.formats = [
            memory.model_format(config, degree) for degree in memory.compact_degrees(config)
        ]
        self.words = [
            (format.layout(0).end - format.layout(0).colours) // memory.CODEBOOK_WORD
            for format in self.formats
        ]
        ports = {
            "start": In(1),  # begin
            # address of the model in beats; stable until `loaded`
            "model_at": In(BEAT_ADDRESS_BITS),
            "ranges": Out(stream_of(range_record(RANGE_BITS))),  # to be read
            "beats": In(stream.Signature(DATA_BITS)),  # their beats
            "write": Out(stream.Signature(codebook_line(config))),  # words of the codebook memory
            "model": Out(ModelState),
            "positions": Out(BEAT_ADDRESS_BITS),  # addresses of these parts in beats
            "attributes": Out(BEAT_ADDRESS_BITS),  # addresses of these parts in beats
            "loaded": Out(1),  # header and codebooks (if any) have been read; until the next start
            # `ErrorCode`; if it is not NONE, the header is invalid and nothing more happens
            "error": Out(CODE_BITS),
            "detail": Out(DETAIL_BITS),  # detail of the error
        }
        if config.levels:
            ports["levels"] = Out(1)  # the model has levels of detail; stable like `model`
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        number = Signal(range(max(memory.HEADER.size // BEAT, *self.words) + 1))
        header, codebooks = Signal(), Signal()  # beats belong to the header, to the codebooks
        colours = self._header(m, number, header)
        words = Array(self.words)[self.model.sh]
        ranges, asked = self.ranges.payload, self.ranges.valid & self.ranges.ready
        last = number == Mux(header, memory.HEADER.size // BEAT, words) - 1
        m.d.comb += self.beats.ready.eq(header | codebooks)
        m.d.comb += [
            self.write.payload.address.eq(number),
            self.write.payload.word.eq(self.beats.payload),
            self.write.valid.eq(codebooks & self.beats.valid),
            ranges.beat.eq(self.model_at),
            ranges.count.eq(memory.HEADER.size // BEAT),
        ]
        with m.If(self.beats.valid & self.beats.ready):
            m.d.sync += number.eq(Mux(last, 0, number + 1))
        through, wrong = self.beats.valid & last, self.error != ErrorCode.NONE
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
                with m.If(through):
                    m.next = "CHECKED"
            with m.State("CHECKED"):
                m.d.comb += self.ranges.valid.eq(~wrong & self.model.codebooks)
                m.d.comb += [ranges.beat.eq(colours), ranges.count.eq(words)]
                with m.If(asked):
                    m.next = "CODEBOOKS"
                with m.Elif(~self.ranges.valid):
                    m.d.sync += self.loaded.eq(~wrong)
                    m.next = "IDLE"
            with m.State("CODEBOOKS"):
                m.d.comb += codebooks.eq(1)
                with m.If(through):
                    m.d.sync += self.loaded.eq(1)
                    m.next = "IDLE"
        return m

    def _address(self, part: Value) -> Value:
        """The address in beats of a part of the model."""
        return self.model_at + part * (memory.ALIGNMENT // BEAT)

    def _header(self, m: Module, number: Value, header: Value) -> Signal:
        """Store and check the fields of header beat `number`; return the codebooks' address."""
        offsets = memory.HEADER.offsets

        def field(name: str) -> Value:
            return self.beats.payload[offsets[name] % DATA_BITS :][: memory.HEADER[name].width]

        def in_beat(name: str) -> Value:
            return number == offsets[name] // DATA_BITS

        model = self.model
        colours, degree = Signal(BEAT_ADDRESS_BITS + 1), Signal(memory.HEADER["sh_degree"].width)
        m.d.comb += model.sh.eq(degree.any())
        names = [register.name for register in frame_registers(self.config)]
        with m.If(self.error == ErrorCode.DEGREE):
            m.d.comb += self.detail.eq(degree)
        with m.If(self.error == ErrorCode.RANGE):
            m.d.comb += self.detail.eq(names.index("MODEL"))
        kept = {"count": model.gaussians, "sh_degree": degree}
        kept |= {"position_exponent": model.position_exponent}
        kept |= {"small": model.small} if self.config.small_models else {}
        kept = {name: (target, field(name)) for name, target in kept.items()}
        if self.config.compensates:
            kept["version"] = model.antialiased, field("version") == memory.VERSIONS[True]
        if self.config.levels:
            versions = [memory.VERSIONS[-1]], [self.levels]
            if self.config.compensates:  # models with levels may have `antialiased` or not
                versions = memory.VERSIONS[1:], [model.antialiased, self.levels]
                kept["antialiased"] = model.antialiased, field("antialiased")
            kept["version"] = Cat(versions[1]), Cat(field("version") == v for v in versions[0])
        parts = {"positions": self.positions, "attributes": self.attributes, "colours": colours}
        kept |= {name: (target, self._address(field(name))) for name, target in parts.items()}
        known = range(EXPONENT_MIN, EXPONENT_MAX + 1)  # of all valid headers
        held = [Signal(known, name=f"exponent{k}", reset_less=True) for k in range(DEGREES)]
        m.d.comb += [model.exponent[k].eq(e) for k, e in enumerate(held)]
        given = [e[: len(held[0])] for e in exponents(field)]
        kept["exponent"] = Cat(held), Cat(given)
        if self.steps:
            kept["colour_index"] = model.codebooks, field("colour_index").any()
        else:
            m.d.comb += model.codebooks.eq(1)
        with m.If(header & self.beats.valid):
            for name, (target, value) in kept.items():
                with m.If(in_beat(name)):
                    m.d.sync += target.eq(value)
            with m.If(self.error == ErrorCode.NONE):
                m.d.sync += self.error.eq(self._error(field, in_beat, degree, colours))
        return colours

    def _error(self, field: Callable, in_beat: Callable, degree: Value, colours: Value) -> Value:
        """The first error in a beat of the header; NONE if there is none."""
        unordered, beyond = self._places(field, colours)
        unfit = [in_beat(name) & ~fit for name, fit in self._fits(field, degree).items()]
        errors = {
            ErrorCode.MAGIC: in_beat("magic") & (field("magic") != memory.MAGIC),
            ErrorCode.VERSION: in_beat("version") & ~self._known(field("version")),
            ErrorCode.DEGREE: in_beat("sh_degree") & (field("sh_degree") > self.config.sh_degree),
            ErrorCode.FORMAT: Cat(unfit).any(),
            ErrorCode.PARTS: Cat(in_beat(name) & wrong for name, wrong in unordered.items()).any(),
            ErrorCode.RANGE: Cat(in_beat(name) & wrong for name, wrong in beyond.items()).any(),
        }
        found = Const(ErrorCode.NONE, CODE_BITS)
        for code, wrong in reversed(errors.items()):
            found = Mux(wrong, code, found)
        return found

    def _known(self, version: Value) -> Value:
        """Whether this machine renders models of a version."""
        known = memory.VERSIONS[: 1 + self.config.compensates]
        known += memory.VERSIONS[-1:] if self.config.levels else ()
        return Cat(version == v for v in known).any()

    def _places(self, field: Callable, colours: Value) -> tuple[dict, dict]:
        """Check the places of the model's parts.

        colours: address of the codebooks
        Returns by field of the header: parts are out of order or too short; they end beyond the
        last address.
        """
        per_unit, model = memory.ALIGNMENT // BEAT, self.model
        chunks = (model.gaussians + memory.CHUNK - 1) >> exact_log2(memory.CHUNK)
        if self.config.levels:
            chunks = chunks << self.levels
        headers = (memory.HEADER.size + chunks * memory.CHUNK_HEADER.size) // BEAT
        halves = Mux(model.small, model.gaussians, model.gaussians << 1)  # half beats of attributes
        in_unit = 2 * per_unit
        end = self._address(field("end"))
        named = Mux(model.codebooks, Array(self.words)[model.sh], 0)
        unordered = {
            "positions": headers > field("positions") * per_unit,
            "attributes": field("positions") > field("attributes"),
            "colours": field("attributes") * in_unit + halves > field("colours") * in_unit,
            "end": colours + named > end,
        }
        last = 1 << BEAT_ADDRESS_BITS
        return unordered, {"colours": field("colours") * per_unit >= last, "end": end > last}

    def _fits(self, field: Callable[[str], Value], degree: Value) -> dict[str, Value]:
        """Fields of the header, and whether this machine supports their values."""
        codes = {}
        for part in ("colour_index", "sh_index"):
            stages = memory.HEADER[part].length
            bits = [getattr(format, part) for format in self.formats]
            sizes = [Cat(Const(k, 8) for k in b + (0,) * (stages - len(b))) for b in bits]
            codes[part] = Mux(self.model.sh, sizes[-1], sizes[0])
        position, index = memory.POSITION_FORMATS.index(self.config.position), field("colour_index")
        compact = (index == codes["colour_index"]) & (degree <= memory.COMPACT_DEGREE)
        sh_index = Mux(self.model.codebooks, codes["sh_index"], 0)
        most = [EXPONENT_MAX] * DEGREES
        most[1] = Mux(index.any(), SH_EXPONENT_MAX, EXPONENT_MAX)
        scale = field("position_exponent").as_signed()
        each = zip(exponents(field), most, strict=True)
        stepped = ~index.any() & ~self.model.small
        antialiased, levels = field("antialiased") == self.model.antialiased, {}
        if self.config.levels:
            levels["levels"] = field("levels") == self.levels
            antialiased |= self.levels if self.config.compensates else 0
        return levels | {
            "antialiased": antialiased,
            "position": field("position") == position,
            "small": Const(1) if self.config.small_models else ~field("small"),
            "position_exponent": (scale >= -memory.EXPONENT_MAX) & (scale <= memory.EXPONENT_MAX),
            "exponent": Cat((e >= EXPONENT_MIN) & (e <= end) for e, end in each).all(),
            "colour_index": compact | stepped if self.steps else compact,
            "sh_index": field("sh_index") == sh_index,
        }


def exponents(field: Callable[[str], Value]) -> list[Value]:
    """E of each degree in the header."""
    codes, width = field("exponent"), memory.HEADER["exponent"].format.width
    return [codes.word_select(degree, width).as_signed() for degree in range(DEGREES)]
