"""Writes finished blocks to the image in memory: rows of 8-bit red, green and blue."""

from amaranth.hdl import Array, Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Register
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, BEAT_BITS, BOUNDARY, DATA_BITS, write_record
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.raster import (
    BLOCKS,
    COLOURS,
    background_code,
    colours,
    owner,
    pixels_record,
    written_record,
)
from splatcore.spec.record import Record
from splatcore.spec.registers import WORD
from splatcore.spec.work import PIXEL, STRIDE_BITS

ROW_BITS = BLOCK * PIXEL * 8  # bits of a row of a block


class Pixels(wiring.Component):
    """Writes a group's blocks: those side by side of one row of blocks together.

    Members
        start: a frame begins. width, height: of its image, pixels; pixels_at, stride_beats:
            its address in memory and the distance of its rows, in beats.
        background: a colour (`spec.group.colour_format`).
        positions: stream of `written_record`, the groups in their order.
        i: streams of `pixels_record`, one for each rasterizer: the group's blocks within the image.
        through: the image's last block has been given.
        writes: to memory.

    **Timing**: a row of `span` blocks in ⌈span · 12 / 16⌉ beats (`DEFAULT`: 4 blocks, 3 beats), and
    for every `BLOCK` such rows 2 cycles more.
    """

    def __init__(self, config: Config):
        self.config, self.span = config, min(config.rasterizers, BLOCKS)
        self.side = exact_log2(config.group)
        pixels = In(stream.Signature(layout(pixels_record(config)))).array(config.rasterizers)
        ports = {
            "start": In(1),
            "width": In(range(config.width_max + 1)),
            "height": In(range(config.height_max + 1)),
            "pixels_at": In(BEAT_ADDRESS_BITS),
            "stride_beats": In(STRIDE_BITS - BEAT_BITS),
            "background": In(layout(Record("colour", colours(config)))),
            "positions": In(stream.Signature(layout(written_record(config)))),
            "i": pixels,
            "through": Out(1),
            "writes": Out(stream.Signature(layout(write_record()))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.written = written = Register(layout(write_record()))
        connect(m, written.o, flipped(self.writes))
        self.write = written.i
        # Present position: tile of the group, row of its blocks, first block of the span.
        self.span_number = Signal(exact_log2(BLOCKS // self.span))
        self.block_row = Signal(exact_log2(BLOCKS))
        self.tile = Signal(2 * self.side)
        self.pixel_row, self.beat = Signal(exact_log2(BLOCK)), Signal(2)
        first, within = self._position()
        heads, present, takes = self._heads(first)
        end = self._beats(m, heads, first)
        self._control(m, first, within, present, end, takes)
        return m

    def _position(self) -> tuple[Value, Value]:
        """The span's first block's column in the image, and its row of pixels in the group."""
        tile_column = self.tile[: self.side]
        tile_row = self.tile[self.side :]
        column = Cat(self.span_number, tile_column, self.positions.payload.position.column)
        first = column << exact_log2(self.span)
        return first, Cat(0, 0, self.block_row, tile_row)

    def _heads(self, first: Value) -> tuple[list[Value], Value, list[Value]]:
        """The present row of the span's blocks; a bit: all within the image are present; and a bit
        for each rasterizer: some of them are its own."""
        heads, present, empty = [], [], self.positions.payload.empty
        plain = self._plain()
        rows = [i.payload.pixels.as_value().word_select(self.pixel_row, ROW_BITS) for i in self.i]
        takes = [Value.cast(0)] * self.config.rasterizers
        spans = BLOCKS // self.span
        for k in range(self.span):
            owners = [
                owner(self.config, row * BLOCKS + span * self.span + k)[0]
                for row in range(BLOCKS)
                for span in range(spans)
            ]
            number = Cat(self.span_number, self.block_row)
            inside = (first + k) * BLOCK < self.width
            heads.append(Mux(empty, plain, Array(rows[who] for who in owners)[number]))
            present.append(Array(self.i[who].valid for who in owners)[number] | ~inside | empty)
            for who in set(owners):
                mine = Cat(number == n for n, other in enumerate(owners) if other == who).any()
                takes[who] = takes[who] | (mine & inside & ~empty)
        return heads, Cat(present).all(), takes

    def _plain(self) -> Value:
        """A row of a block of nothing but background."""
        codes = [background_code(self.config, self.background[name]) for name in COLOURS]
        return Cat(Mux(code > 255, 255, code)[:8] for code in codes).replicate(BLOCK)

    def _beats(self, m: Module, heads: list[Value], first: Value) -> Value:
        """A row of the span as beats; the number of the last one."""
        words = ROW_BITS // 8 // WORD  # of a row of a block
        # A span begins at a multiple of 4 bytes.
        skipped = (first * words)[: exact_log2(BEAT // WORD)]
        if self.span == BLOCKS:
            skipped = Value.cast(0)
        segment = Cat(heads) << (skipped * WORD * 8)
        pixels = Mux(
            (first + self.span) * BLOCK > self.width,
            (self.width - first * BLOCK)[: exact_log2(self.span * BLOCK) + 1],
            self.span * BLOCK,
        )
        begin, size = skipped * WORD, pixels * PIXEL
        behind = begin + size
        write = self.write.payload
        bytes_ = [Cat(self.beat << BEAT_BITS) + k for k in range(BEAT)]
        words_of_beat = segment.word_select(self.beat, DATA_BITS)
        m.d.comb += write.low.eq(words_of_beat[: DATA_BITS // 2])
        m.d.comb += write.high.eq(words_of_beat[DATA_BITS // 2 :])
        m.d.comb += write.strobe.eq(Cat((byte >= begin) & (byte < behind) for byte in bytes_))
        return (behind - 1) >> BEAT_BITS

    def _control(
        self, m: Module, first: Value, within: Value, present: Value, end: Value, takes: list
    ):
        """Group after group, tile after tile, span after span."""
        config, write = self.config, self.write.payload
        position = self.positions.payload.position
        side = TILE * config.group
        group_at, line = Signal(BEAT_ADDRESS_BITS), Signal(BEAT_ADDRESS_BITS)
        within_image = (first * BLOCK < self.width) & (
            (position.row * side + within)[: len(self.height) + 1] < self.height
        )
        below = position.row * side + within + self.pixel_row + 1 >= self.height
        steps = Cat(self.span_number, self.block_row, self.tile)
        last_span, moves = steps.all(), Signal()
        last_group = ((position.column + 1) * side >= self.width) & (
            (position.row + 1) * side >= self.height
        )
        page = exact_log2(BOUNDARY // BEAT)
        crosses = (line[:page] + end)[page]  # then each beat is a burst of its own
        m.d.comb += [
            write.beat.eq(line + Mux(crosses, self.beat, 0)),
            write.length.eq(Mux(crosses, 0, end)),
            self.positions.ready.eq(moves & last_span),
            self.through.eq(moves & last_span & last_group),
        ]
        with m.If(moves):
            m.d.sync += steps.eq(steps + 1)
            with m.If(last_span & (((position.column + 1) * side) >= self.width)):
                m.d.sync += group_at.eq(group_at + self.stride_beats * side)
        last_row = (self.pixel_row == BLOCK - 1) | below
        with m.FSM():
            with m.State("POSITION"):
                column = (first * (ROW_BITS // 8)) >> BEAT_BITS
                m.d.sync += line.eq(group_at + within * self.stride_beats + column)
                with m.If(self.positions.valid):
                    with m.If(~within_image):
                        m.d.comb += moves.eq(1)
                    with m.Elif(present):
                        m.next = "ROWS"
            with m.State("ROWS"):
                m.d.comb += self.write.valid.eq(1)
                with m.If(self.write.ready):
                    m.d.sync += self.beat.eq(self.beat + 1)
                    with m.If(self.beat == end):
                        m.d.sync += [self.beat.eq(0), self.pixel_row.eq(self.pixel_row + 1)]
                        m.d.sync += line.eq(line + self.stride_beats)
                        with m.If(last_row):
                            m.d.sync += self.pixel_row.eq(0)
                            m.d.comb += moves.eq(1)
                            m.d.comb += [
                                i.ready.eq(take) for i, take in zip(self.i, takes, strict=True)
                            ]
                            m.next = "POSITION"
        with m.If(self.start):
            m.d.sync += group_at.eq(self.pixels_at)
