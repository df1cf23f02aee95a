"""Forms the beats of a span's rows: bytes of its blocks or of the background, and their strobes."""

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.raster.spans import ROW_BEATS_BITS, row_bytes, span_layout
from splatcore.spec.axi import port_bytes
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.pixel import background_code
from splatcore.spec.raster import (
    BLOCKS,
    COLOURS,
    colours,
    owner,
    pixels_record,
    span_blocks,
    spans_meet,
)
from splatcore.spec.record import Record
from splatcore.spec.registers import WORD
from splatcore.spec.work import PIXEL, PIXEL_RGBA, pixel_bytes


class SpanData(wiring.Component):
    """The beats of the spans that `hdl.raster.spans` visits.

    Of two spans that share a beat, the first leaves its bytes of each row to the second.

    **Timing**: combinational from `i`, `span` and the bytes left; the background takes one cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        # Bytes left to the next span.
        self.kept = row_bytes(config) % port_bytes(config) if spans_meet(config) else 0
        ports = {
            # a colour (`spec.colour.colour_format`), also for groups without splats
            "background": In(layout(Record("colour", colours(config)))),
            "span": In(span_layout(config)),
            "taken": In(1),  # the beat is written
            "done": In(1),  # the span is done: its blocks are taken
            # one per rasterizer
            "i": In(stream_of(pixels_record(config))).array(config.rasterizers),
            "present": Out(1),  # all blocks of the next span of the group with splats are present
            # bytes that the span before leaves to this one are present, or there are none
            "tail": Out(1),
            "bytes": Out(8 * port_bytes(config)),  # the beat
            "strobe": Out(port_bytes(config)),  # one bit per byte: it belongs to the span
        }
        if config.rgba:
            ports["rgba"] = In(1)  # pixels have alpha; then `background` is 0
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        size, span, about = port_bytes(self.config), self.span, self.span.about
        heads = self._heads(m)
        if self.config.rgba:
            heads = Mux(self.rgba, heads, self._without_alpha(heads))
        segment, begin = heads << (about.skipped * WORD * 8), about.skipped * WORD
        m.d.comb += self.tail.eq(1)
        if self.kept:
            left = self._left(m, heads)
            segment |= Mux(about.second, left.payload, 0)
            begin = Mux(about.second, 0, begin)
            m.d.comb += self.tail.eq(~about.second | span.beat.any() | left.valid)
        numbers = [Cat(span.beat << exact_log2(size)) + k for k in range(size)]
        of_blocks = segment.word_select(span.beat, size * 8)
        m.d.comb += [
            self.bytes.eq(Mux(span.plain, self._background(m), of_blocks)),
            self.strobe.eq(Cat((n >= begin) & (n < about.behind) for n in numbers)),
        ]
        return m

    def _heads(self, m: Module) -> Value:
        """The present row of the span's blocks; blocks are taken when the span is done."""
        width, number = span_blocks(self.config), self.span.blocks
        bits = BLOCK * pixel_bytes(self.config.rgba) * 8  # of a row of a block
        rows = [i.payload.pixels.as_value().word_select(self.span.row, bits) for i in self.i]
        heads, present = [], []
        takes = [Const(0)] * self.config.rasterizers
        for k in range(width):  # the k-th block of each span of a tile
            owners = [owner(self.config, n + k) for n in range(0, BLOCKS**2, width)]
            heads.append(Array(rows[own] for own in owners)[number])
            present.append(Array(self.i[own].valid for own in owners)[number])
            for own in set(owners):
                takes[own] |= Cat(number == n for n, o in enumerate(owners) if o == own).any()
        m.d.comb += self.present.eq(Cat(present).all())
        for i, take in zip(self.i, takes, strict=True):
            m.d.comb += i.ready.eq(self.done & ~self.span.plain & take)
        return Cat(heads)

    def _without_alpha(self, heads: Value) -> Value:
        """The present row of an image without alpha."""
        step = PIXEL_RGBA * 8
        return Cat(heads[at : at + PIXEL * 8] for at in range(0, len(heads), step))

    def _left(self, m: Module, heads: Value) -> stream.Interface:
        """The queue of bytes that each row of a span leaves to the next one; returns its output."""
        m.submodules.tails = tails = Queue(8 * self.kept, BLOCK, memory=True)
        span, row = self.span, row_bytes(self.config)
        own = self.taken & ~span.plain
        last = span.beat == row // port_bytes(self.config) - 1
        m.d.comb += [
            tails.i.valid.eq(own & span.about.keeps & last),
            tails.i.payload.eq(heads[8 * (row - self.kept) : 8 * row]),
            tails.o.ready.eq(own & span.about.second & ~span.beat.any()),
        ]
        never_waits(m, "kept", tails.i, "bytes that a span's row leaves to the next span")
        return tails.o

    def _background(self, m: Module) -> Value:
        """A beat of background; its first colour depends on beat and words before the span."""
        codes = [background_code(self.config, self.background[name]) for name in COLOURS]
        codes = [Mux(code > 255, 255, code)[:8] for code in codes]
        stays = Signal(data.ArrayLayout(8, PIXEL), name="codes", reset_less=True)  # for a frame
        m.d.sync += stays.eq(Cat(codes))
        size = port_bytes(self.config)
        turned = [
            Cat(stays[(beat * size - words * WORD + k) % PIXEL] for k in range(size))
            for words in range(size // WORD)
            for beat in range(1 << ROW_BEATS_BITS)
        ]
        return Array(turned)[Cat(self.span.beat, self.span.about.skipped)]
