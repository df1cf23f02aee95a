"""Writes finished blocks to the image in memory: rows of 8-bit red, green and blue."""

from itertools import pairwise

from amaranth.hdl import Array, Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue, Register, passes
from splatcore.hdl.memory.axi import write_data
from splatcore.spec.axi import (
    BEAT_ADDRESS_BITS,
    BEAT_BITS,
    BOUNDARY,
    port_beats,
    port_bytes,
    write_record,
)
from splatcore.spec.binning import groups_max
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.group import group_pixels
from splatcore.spec.raster import (
    BLOCKS,
    COLOURS,
    background_code,
    colours,
    owner,
    pixels_record,
    position_record,
    span_blocks,
    spans_meet,
    tiles_meet,
)
from splatcore.spec.record import Record
from splatcore.spec.registers import WORD
from splatcore.spec.work import PIXEL, STRIDE_BITS

ROW_BITS = BLOCK * PIXEL * 8  # bits of a row of a block


class Pixels(wiring.Component):
    """Writes groups of finished blocks span by span: the adjacent blocks of one row of blocks.

    Two groups are processed at a time: one with blocks from the rasterizers, and one without
    splats, of which a span is written whenever blocks of the other group's next span are missing.
    If two adjacent spans share a beat (`spec.raster.spans_meet`), the second one writes it.

    Members:
        start: in, a frame begins
        width, height: in, of its image, pixels
        groups: in, number of its groups
        pixels_at, stride_beats: in, address of the image and distance of its rows, in beats
        background: in, a colour (`spec.colour.colour_format`), also for groups without splats
        positions, empty: in, streams of `position_record`, the groups with and without splats by
            rows
        i: in, streams of `pixels_record`, one per rasterizer: blocks of the groups with splats in
            the order of `spec.raster.nth_block`
        plain: out, a group without splats is being written
        through: out, the image's last span is done
        writes: out, stream of `write_record` to memory

    **Timing**: a row of a span takes one cycle per beat of the port (4 blocks: 3 of 128 bits; 1 of
    256 bits, then 2), without a pause between spans. One cycle more per group, and per change to
    the other group (two if blocks turn out to be missing); two per span outside the image. If the
    next group is some rows of groups farther down, as many cycles more.
    """

    def __init__(self, config: Config):
        self.config, self.span = config, span_blocks(config)
        self.side = exact_log2(config.group)
        self.row = self.span * ROW_BITS // 8  # bytes of a row of a span
        # Bytes left to the next span.
        self.kept = self.row % port_bytes(config) if spans_meet(config) else 0
        pixels = In(stream_of(pixels_record(config))).array(config.rasterizers)
        position = In(stream_of(position_record(config)))
        ports = {
            "start": In(1),
            "width": In(range(config.side_max + 1)),
            "height": In(range(config.side_max + 1)),
            "groups": In(range(groups_max(config) + 1)),
            "pixels_at": In(BEAT_ADDRESS_BITS),
            "stride_beats": In(STRIDE_BITS - BEAT_BITS),
            "background": In(layout(Record("colour", colours(config)))),
            "positions": position,
            "empty": position,
            "i": pixels,
            "plain": Out(1),
            "through": Out(1),
            "writes": Out(stream_of(write_record(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.written = register = Register(layout(write_record(self.config)))
        connect(m, register.o, flipped(self.writes))
        self.write = register.i
        below = exact_log2(port_beats(self.config))
        self.port_pixels_at, self.stride = self.pixels_at[below:], self.stride_beats[below:]
        if self.kept:
            m.submodules.tails = self.tails = Queue(8 * self.kept, BLOCK, memory=True)
        # Parts of a span's number: in a row of blocks of one or two tiles, that row, the tile or
        # pair of tiles.
        meet = tiles_meet(self.config)
        self.counts = (
            exact_log2(BLOCKS // self.span) + meet,
            exact_log2(BLOCKS),
            2 * self.side - meet,
        )
        self.blocks_span, self.empty_span = Signal(sum(self.counts)), Signal(sum(self.counts))
        self.pixel_row, self.beat = Signal(exact_log2(BLOCK)), Signal(2)
        # The present group.
        self.span_number = Mux(self.plain, self.empty_span, self.blocks_span)
        place = Signal(self.positions.payload.shape())
        m.d.comb += place.eq(Mux(self.plain, self.empty.payload, self.positions.payload))
        heads, present, takes = self._heads()
        # The span that begins next: this one, or with `following` the one behind it.
        self.following = Signal()
        spans = self.empty_span, self.blocks_span
        number = Mux(self.plain, *((span + self.following)[: sum(self.counts)] for span in spans))
        self.column, self.block_row = self._place(number, place)
        self.row_of_blocks = Cat(self.block_row, place.row)
        coming = self._about(self.column) | {"row": self.row_of_blocks}
        work = {
            name: Signal.like(value, name=name, reset_less=True) for name, value in coming.items()
        }
        self.begins = [register.eq(coming[name]) for name, register in work.items()]
        tail_ok = self._beats(m, heads, work)
        self._control(m, work, present, tail_ok, takes)
        return m

    def _place(self, span: Value, position) -> tuple[Value, Value]:
        """A span's column of spans in the image, and its row of blocks in the group."""
        number, block_row, tile = self._parts(span)
        across = self.side - tiles_meet(self.config)
        return Cat(number, tile[:across], position.column), Cat(block_row, tile[across:])

    def _group_rows(self, m: Module) -> tuple[Value, Value]:
        """Address of the present group's row of groups, in beats of the port, and whether it is
        valid; each address follows from the previous row's."""
        found = []
        for groups in (self.empty, self.positions):
            row, at = Signal.like(groups.payload.row), Signal.like(self.port_pixels_at)
            reached = groups.payload.row == row
            with m.If(self.start):
                m.d.sync += [row.eq(0), at.eq(self.port_pixels_at)]
            with m.Elif(groups.valid & ~reached):
                m.d.sync += [row.eq(row + 1), at.eq(at + self.stride * group_pixels(self.config))]
            found.append((at, reached))
        at, reached = (Mux(self.plain, *each) for each in zip(*found, strict=True))
        return at, reached

    def _parts(self, span: Value) -> list[Value]:
        """The parts of a span's number, with the widths in `counts`."""
        ends = [sum(self.counts[:k]) for k in range(len(self.counts) + 1)]
        return [span[low:high] for low, high in pairwise(ends)]

    def _heads(self) -> tuple[list[Value], Value, list[Value]]:
        """The present row of the span's blocks, for the group with splats; whether all blocks are
        present; one bit per rasterizer: it owns one of them."""
        heads, present = [], []
        rows = [i.payload.pixels.as_value().word_select(self.pixel_row, ROW_BITS) for i in self.i]
        takes = [Value.cast(0)] * self.config.rasterizers
        part, row, _ = self._parts(self.blocks_span)
        spans = BLOCKS // self.span
        number = Cat(part[: exact_log2(spans)], row)
        for k in range(self.span):
            owners = [
                owner(self.config, row * BLOCKS + span * self.span + k)[0]
                for row in range(BLOCKS)
                for span in range(spans)
            ]
            heads.append(Array(rows[own] for own in owners)[number])
            present.append(Array(self.i[own].valid for own in owners)[number])
            for own in set(owners):
                mine = Cat(number == n for n, other in enumerate(owners) if other == own).any()
                takes[own] = takes[own] | mine
        return heads, self.positions.valid & Cat(present).all(), takes

    def _background(self, m: Module, skipped: Value) -> Value:
        """A beat of background; its first colour depends on beat and words before the span."""
        codes = [background_code(self.config, self.background[name]) for name in COLOURS]
        codes = [Mux(code > 255, 255, code)[:8] for code in codes]
        stays = Signal(data.ArrayLayout(8, PIXEL), name="codes", reset_less=True)  # for a frame
        m.d.sync += stays.eq(Cat(codes))
        size = port_bytes(self.config)
        turned = [
            Cat(stays[(beat * size - words * WORD + k) % PIXEL] for k in range(size))
            for words in range(size // WORD)
            for beat in range(1 << len(self.beat))
        ]
        return Array(turned)[Cat(self.beat, skipped)]

    def _about(self, column: Value) -> dict[str, Value]:
        """Per-span values from which its beats are formed (column within the image).

        skipped: words before it in its first beat
        behind, end: the byte behind it, the last beat
        second, keeps: of two spans that share a beat: it is the second; it leaves the beat to that
        """
        words = ROW_BITS // 8 // WORD  # of a row of a block
        size, row = port_bytes(self.config), self.row
        # A span begins at a multiple of 4 bytes.
        skipped = (column * self.span * words)[: exact_log2(size // WORD)]
        if row % size == 0:
            skipped = Const(0, len(skipped))
        most = self.span * BLOCK  # pixels
        below, whole = self.width[: exact_log2(most)], self.width >> exact_log2(most)
        pixels = Mux(column >= whole, below, most)
        behind = skipped * WORD + pixels * PIXEL
        end = (behind - 1) >> exact_log2(size)
        if not self.kept:
            return {"skipped": skipped, "behind": behind, "end": end}
        second = column[0]
        keeps = ~second & (column < (self.width - 1) >> exact_log2(most))
        end = Mux(keeps, row // size - 1, end)
        return {
            "skipped": skipped, "behind": behind, "end": end, "second": second, "keeps": keeps
        }  # fmt: skip

    def _beats(self, m: Module, heads: list[Value], work: dict[str, Value]) -> Value:
        """Form a span's row of beats; return whether the previous span's bytes are available."""
        size, row = port_bytes(self.config), self.row
        skipped, behind = work["skipped"], work["behind"]
        segment, begin, tail_ok = Cat(heads) << (skipped * WORD * 8), skipped * WORD, Const(1)
        if self.kept:
            second, keeps = work["second"], work["keeps"]
            i, o = self.tails.i, self.tails.o
            own = passes(self.write) & ~self.plain
            m.d.comb += [
                i.valid.eq(own & keeps & (self.beat == row // size - 1)),
                i.payload.eq(Cat(heads)[8 * (row - self.kept) :]),
                o.ready.eq(own & second & ~self.beat.any()),
            ]
            segment |= Mux(second, o.payload, 0)
            begin, tail_ok = Mux(second, 0, begin), ~second | self.beat.any() | o.valid
            never_waits(m, "kept", i, "bytes that a span's row leaves to the next span")
        write = self.write.payload
        bytes_ = [Cat(self.beat << exact_log2(size)) + k for k in range(size)]
        of_blocks = segment.word_select(self.beat, size * 8)
        beat = Mux(self.plain, self._background(m, skipped), of_blocks)
        m.d.comb += write_data(self.config, write).eq(beat)
        m.d.comb += write.strobe.eq(Cat((byte >= begin) & (byte < behind) for byte in bytes_))
        return tail_ok

    def _control(self, m: Module, work: dict, present: Value, tail_ok: Value, takes: list):
        """Write span after span; change to the other group after a span, or if blocks are missing.

        work, present: `_about` the span; its blocks are present
        tail_ok: bytes left by the previous span are available"""
        write, given, inside = self.write, Signal(), Signal()
        row, end = work["row"], work["end"]
        size, below = port_bytes(self.config), exact_log2(port_beats(self.config))
        line = Signal.like(self.port_pixels_at)  # of pixels
        at, reached = self._group_rows(m)
        at += self.block_row * BLOCK * self.stride + (self.column * self.row >> exact_log2(size))
        across = self.column * self.span * BLOCK < self.width
        m.d.comb += inside.eq(across & (self.row_of_blocks * BLOCK < self.height))
        page = exact_log2(BOUNDARY // size)
        crosses = (line[:page] + end)[page]  # if so, each beat is a separate burst
        last_row = (self.pixel_row == BLOCK - 1) | (row * BLOCK + self.pixel_row + 1 >= self.height)
        m.d.comb += [
            write.payload.beat.eq((line + Mux(crosses, self.beat, 0)) << below),
            write.payload.length.eq(Mux(crosses, 0, end)),
        ]
        with m.FSM():
            with m.State("PLACE"):
                m.d.sync += [line.eq(at), *self.begins]
                with m.If(~Mux(self.plain, self.empty.valid, self.positions.valid)):
                    m.d.sync += self.plain.eq(self.empty.valid)
                with m.Elif(inside & reached):
                    m.next = "ROWS"
                with m.Elif(~inside):
                    m.next = "BEYOND"
            with m.State("BEYOND"):  # the image
                m.d.comb += given.eq(self.plain | present)
                with m.If(given):
                    m.next = "PLACE"
            with m.State("ROWS"):
                m.d.comb += [write.valid.eq(self.plain | (present & tail_ok)), self.following.eq(1)]
                with m.If(~write.valid & self.empty.valid):
                    m.d.sync += self.plain.eq(1)
                    m.next = "PLACE"
                with m.Elif(write.valid & write.ready):
                    m.d.sync += self.beat.eq(self.beat + 1)
                    with m.If(self.beat == end):
                        m.d.sync += [self.beat.eq(0), self.pixel_row.eq(self.pixel_row + 1)]
                        m.d.sync += line.eq(line + self.stride)
                        with m.If(last_row):
                            m.d.sync += [self.pixel_row.eq(0), line.eq(at), *self.begins]
                            m.d.comb += given.eq(1)
                            with m.If(self.plain & present):
                                m.d.sync += self.plain.eq(0)
                                m.next = "PLACE"
                            with m.Elif(~inside | self.span_number.all()):
                                m.next = "PLACE"
        self._advance(m, given, takes)

    def _advance(self, m: Module, given: Value, takes: list[Value]):
        """Go to a group's next span, and to the next group. given: the present span is done."""
        spans = self.blocks_span, self.empty_span
        done = Signal.like(self.groups)
        through = given & self.span_number.all()
        for span, groups, own in zip(
            spans, (self.positions, self.empty), (~self.plain, self.plain), strict=True
        ):
            m.d.comb += groups.ready.eq(through & own)
            with m.If(given & own):
                m.d.sync += span.eq(span + 1)
        for i, take in zip(self.i, takes, strict=True):
            m.d.comb += i.ready.eq(given & ~self.plain & take)
        m.d.comb += self.through.eq(through & (done + 1 == self.groups))
        with m.If(self.start):
            m.d.sync += done.eq(0)
        with m.Elif(through):
            m.d.sync += done.eq(done + 1)
