"""Writes finished blocks to the image in memory: rows of 8-bit red, green, blue and maybe alpha."""

from amaranth.hdl import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Register, passes
from splatcore.hdl.memory.axi import write_data
from splatcore.hdl.raster.job import job_layout
from splatcore.hdl.raster.span_data import SpanData
from splatcore.hdl.raster.spans import Spans
from splatcore.spec.axi import write_record
from splatcore.spec.binning import groups_max
from splatcore.spec.config import Config
from splatcore.spec.raster import pixels_record, position_record


class Pixels(wiring.Component):
    """Writes groups of finished blocks span by span: the adjacent blocks of one row of blocks.

    Two groups are processed at a time: one with blocks from the rasterizers, and one without
    splats, of which a span is written whenever blocks of the other group's next span are missing.
    If two adjacent spans share a beat (`spec.raster.spans_meet`), the second one writes it.

        positions, empty ──▶ Spans ── bursts ────────────────▶ Register ──▶ writes
                              │ ▲                                  ▲
                   span, done │ │ present, tail                    │
                              ▼ │                                  │
                i (blocks) ──▶ SpanData ── bytes, strobe ──────────┘

    **Timing**: a row of a span takes one cycle per beat of the port (4 blocks: 3 of 128 bits; 1 of
    256 bits, then 2; with alpha 4 or 2), without a pause between spans. One cycle more per group,
    and per change to the other group (two if blocks turn out to be missing); two per span outside
    the image. If the next group is some rows of groups farther down, as many cycles more.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "start": In(1),  # a frame begins
            "job": In(job_layout(config)),  # its parameters
            "groups": In(range(groups_max(config) + 1)),  # number of its groups
            # the groups with and without splats by rows
            "positions": In(stream_of(position_record(config))),
            "empty": In(stream_of(position_record(config))),
            # one per rasterizer: blocks of the groups with splats in the order of
            # `spec.raster.nth_block`
            "i": In(stream_of(pixels_record(config))).array(config.rasterizers),
            "plain": Out(1),  # a group without splats is being written
            "through": Out(1),  # the image's last span is done
            "writes": Out(stream_of(write_record(config))),  # to memory
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.spans = spans = Spans(self.config)
        m.submodules.data = data = SpanData(self.config)
        m.submodules.written = written = Register(layout(write_record(self.config)))
        outside, write = flipped(self), written.i.payload
        connect(m, outside.positions, spans.positions)
        connect(m, outside.empty, spans.empty)
        for blocks, i in zip(self.i, data.i, strict=True):
            connect(m, flipped(blocks), i)
        connect(m, written.o, outside.writes)
        m.d.comb += [
            spans.start.eq(self.start),
            spans.job.eq(self.job),
            spans.groups.eq(self.groups),
            spans.present.eq(data.present & self.positions.valid),
            spans.tail.eq(data.tail),
            data.background.eq(self.job.background),
            data.span.eq(spans.span),
            data.done.eq(spans.done),
            data.taken.eq(passes(spans.bursts)),
            written.i.valid.eq(spans.bursts.valid),
            spans.bursts.ready.eq(written.i.ready),
            write.beat.eq(spans.bursts.payload.beat),
            write.length.eq(spans.bursts.payload.length),
            write.strobe.eq(data.strobe),
            write_data(self.config, write).eq(data.bytes),
            self.plain.eq(spans.span.plain),
            self.through.eq(spans.through),
        ]
        if self.config.rgba:
            m.d.comb += data.rgba.eq(self.job.rgba)
        return m
