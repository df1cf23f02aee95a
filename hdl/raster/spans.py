"""Walks over the image span by span: the place of each span, its rows and their bursts."""

from collections.abc import Callable
from itertools import pairwise

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import passes
from splatcore.hdl.raster.job import job_layout
from splatcore.spec import axi
from splatcore.spec.binning import groups_max
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.group import group_pixels
from splatcore.spec.raster import BLOCKS, position_record, span_blocks, spans_meet, tiles_meet
from splatcore.spec.registers import WORD
from splatcore.spec.work import PIXEL, PIXEL_RGBA, pixel_bytes

BURST = data.StructLayout({"beat": axi.BEAT_ADDRESS_BITS, "length": axi.LENGTH_BITS})
"""The burst of a beat, as in `spec.axi.write_record`."""

ROW_BEATS_BITS = 2
"""A row of a span has at most 4 beats."""


def row_bytes(config: Config, pixel: int = PIXEL) -> int:
    """Bytes of a row of a span. pixel: bytes of a pixel"""
    return span_blocks(config) * BLOCK * pixel


def span_layout(config: Config) -> data.StructLayout:
    """The present span and beat. about: values that all rows of the span share."""
    size, row = axi.port_bytes(config), row_bytes(config, pixel_bytes(config.rgba))
    about = data.StructLayout({
        "skipped": range(size // WORD),  # words before the span in its first beat
        "behind": range(size + row),  # the byte behind it, counted from that beat's first
        "end": ROW_BEATS_BITS,  # its last beat
        # Of two spans that share a beat:
        "second": 1,  # it writes that beat, with bytes of the span before
        "keeps": 1,  # it leaves the beat to the span behind
    })  # fmt: skip
    return data.StructLayout({
        "plain": 1,  # its group has no splats
        # number in its tile of the next span of the group with splats: this one, if not plain
        "blocks": range(BLOCKS**2 // span_blocks(config)),
        "row": range(BLOCK),
        "beat": ROW_BEATS_BITS,  # in that row
        "about": about,
    })  # fmt: skip


class Spans(wiring.Component):
    """Visits the spans of two groups, one with splats and one without, each row by row and beat by
    beat.

    A span of the group without splats is next whenever blocks of the other group's are missing.

    **Timing**: as in `hdl.raster.pixels`.
    """

    def __init__(self, config: Config):
        self.config, self.size = config, axi.port_bytes(config)
        meet, side = tiles_meet(config), exact_log2(config.group)
        # Parts of a span's number: in a row of blocks of one or two tiles, that row, the tile or
        # pair of tiles.
        part = exact_log2(BLOCKS // span_blocks(config))
        self.parts = (part + meet, exact_log2(BLOCKS), 2 * side - meet)
        self.in_tile, self.across = part, side - meet  # bits within a tile, of tiles in a row
        ports = {
            "start": In(1),  # a frame begins
            "job": In(job_layout(config)),  # its parameters
            "groups": In(range(groups_max(config) + 1)),  # number of its groups
            # the groups with and without splats by rows
            "positions": In(stream_of(position_record(config))),
            "empty": In(stream_of(position_record(config))),
            "present": In(1),  # all blocks of the next span of the group with splats are present
            # bytes that the span before leaves to this one are present, or there are none
            "tail": In(1),
            "span": Out(span_layout(config)),
            "bursts": Out(stream.Signature(BURST)),  # one item per beat
            "done": Out(1),  # the span is done
            "through": Out(1),  # the image's last span is done
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        below, page = exact_log2(axi.port_beats(self.config)), exact_log2(axi.BOUNDARY // self.size)
        span, plain, beat = self.span, self.span.plain, self.span.beat
        # The present spans of both groups; the next one is the same, or `following` it.
        blocks, empty = (Signal(sum(self.parts), name=name) for name in ("blocks", "empty"))
        following = Signal()
        number = Mux(plain, *((n + following)[: len(n)] for n in (empty, blocks)))
        coming, rows, at, reached, inside = self._coming(m, plain, number)
        # Of the present span: the values of `span_layout`, its row of blocks, its row's address.
        about = Signal(span.about.shape(), reset_less=True)
        down = Signal(len(rows), reset_less=True)
        line = Signal(len(self.job.pixels) - below)
        begins = [about.eq(coming), down.eq(rows), line.eq(at)]
        last_row = (span.row == BLOCK - 1) | (down * BLOCK + span.row + 1 >= self.job.height)
        crosses = (line[:page] + about.end)[page]  # if so, each beat is a separate burst
        present_part, present_row, _ = self._cut(blocks)
        m.d.comb += [
            self.bursts.payload.beat.eq((line + Mux(crosses, beat, 0)) << below),
            self.bursts.payload.length.eq(Mux(crosses, 0, about.end)),
            span.blocks.eq(Cat(present_part[: self.in_tile], present_row)),
            span.about.eq(about),
        ]
        with m.FSM():
            with m.State("PLACE"):
                m.d.sync += begins
                with m.If(~Mux(plain, self.empty.valid, self.positions.valid)):
                    m.d.sync += plain.eq(self.empty.valid)
                with m.Elif(inside & reached):
                    m.next = "ROWS"
                with m.Elif(~inside):
                    m.next = "BEYOND"
            with m.State("BEYOND"):  # the image
                m.d.comb += self.done.eq(plain | self.present)
                with m.If(self.done):
                    m.next = "PLACE"
            with m.State("ROWS"):
                m.d.comb += self.bursts.valid.eq(plain | (self.present & self.tail))
                m.d.comb += following.eq(1)
                with m.If(~self.bursts.valid & self.empty.valid):
                    m.d.sync += plain.eq(1)
                    m.next = "PLACE"
                with m.Elif(passes(self.bursts)):
                    m.d.sync += beat.eq(beat + 1)
                    with m.If(beat == about.end):
                        m.d.sync += [beat.eq(0), span.row.eq(span.row + 1)]
                        m.d.sync += line.eq(line + self.job.stride[below:])
                        with m.If(last_row):
                            m.d.sync += [span.row.eq(0), *begins]
                            m.d.comb += self.done.eq(1)
                            with m.If(plain & self.present):
                                m.d.sync += plain.eq(0)
                                m.next = "PLACE"
                            with m.Elif(~inside | Mux(plain, empty, blocks).all()):
                                m.next = "PLACE"
        self._advance(m, plain, blocks, empty)
        return m

    def _cut(self, number: Value) -> list[Value]:
        """The parts of a span's number."""
        ends = [sum(self.parts[:k]) for k in range(len(self.parts) + 1)]
        return [number[low:high] for low, high in pairwise(ends)]

    def _coming(self, m: Module, plain: Value, number: Value) -> tuple[Value, ...]:
        """The span that begins next: its `about`, its row of blocks and its address, whether that
        is known, and whether it is in the image.
        """
        place, inside = Signal(self.positions.payload.shape()), Signal()
        m.d.comb += place.eq(Mux(plain, self.empty.payload, self.positions.payload))
        part, block_row, tile = self._cut(number)
        column = Cat(part, tile[: self.across], place.column)
        in_group = Cat(block_row, tile[self.across :])  # row of blocks
        down = Cat(in_group, place.row)
        stride = self.job.stride[exact_log2(axi.port_beats(self.config)) :]
        at, reached = self._group_rows(m, plain, stride)
        before = self._by_pixel(lambda pixel: column * row_bytes(self.config, pixel))
        at += in_group * BLOCK * stride + (before >> exact_log2(self.size))
        across = column * span_blocks(self.config) * BLOCK < self.job.width
        m.d.comb += inside.eq(across & (down * BLOCK < self.job.height))
        about = self._by_pixel(lambda pixel: self._about(column, pixel))
        return about, down, at, reached, inside

    def _by_pixel(self, value: Callable[[int], Value]) -> Value:
        """A value that depends on the bytes of a pixel, for the frame's format."""
        found = value(PIXEL)
        return Mux(self.job.rgba, value(PIXEL_RGBA), found) if self.config.rgba else found

    def _group_rows(self, m: Module, plain: Value, stride: Value) -> tuple[Value, Value]:
        """Address of the present group's row of groups, in beats of the port, and whether it is
        valid; each address follows from the previous row's."""
        found, first = [], self.job.pixels[exact_log2(axi.port_beats(self.config)) :]
        for groups in (self.empty, self.positions):
            row, at = Signal.like(groups.payload.row), Signal.like(first)
            reached = groups.payload.row == row
            with m.If(self.start):
                m.d.sync += [row.eq(0), at.eq(first)]
            with m.Elif(groups.valid & ~reached):
                m.d.sync += [row.eq(row + 1), at.eq(at + stride * group_pixels(self.config))]
            found.append((at, reached))
        at, reached = (Mux(plain, *each) for each in zip(*found, strict=True))
        return at, reached

    def _about(self, column: Value, pixel: int) -> Value:
        """The values that all rows of a span share, from its column of spans in the image and the
        bytes of a pixel.
        """
        size, row = self.size, row_bytes(self.config, pixel)
        most = span_blocks(self.config) * BLOCK  # pixels
        # A span begins at a multiple of 4 bytes.
        skipped = (column * (row // WORD))[: exact_log2(size // WORD)]
        if row % size == 0:
            skipped = Const(0, len(skipped))
        below, whole = self.job.width[: exact_log2(most)], self.job.width >> exact_log2(most)
        behind = skipped * WORD + Mux(column >= whole, below, most) * pixel
        end = (behind - 1) >> exact_log2(size)
        second, keeps = Const(0), Const(0)
        if spans_meet(self.config) and pixel == PIXEL:
            second = column[0]
            keeps = ~second & (column < (self.job.width - 1) >> exact_log2(most))
            end = Mux(keeps, row // size - 1, end)
        shapes = self.span.about.shape().members.values()
        values = (skipped, behind, end, second, keeps)
        return Cat(
            value[: Shape.cast(shape).width] for value, shape in zip(values, shapes, strict=True)
        )

    def _advance(self, m: Module, plain: Value, blocks: Value, empty: Value):
        """Go to a group's next span, and to the next group."""
        written = Signal.like(self.groups)  # groups
        through = self.done & Mux(plain, empty, blocks).all()
        for span, groups, own in ((blocks, self.positions, ~plain), (empty, self.empty, plain)):
            m.d.comb += groups.ready.eq(through & own)
            with m.If(self.done & own):
                m.d.sync += span.eq(span + 1)
        m.d.comb += self.through.eq(through & (written + 1 == self.groups))
        with m.If(self.start):
            m.d.sync += written.eq(0)
        with m.Elif(through):
            m.d.sync += written.eq(written + 1)
