"""Writes items of a fixed number of beats to memory."""

from amaranth.hdl import Const, Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, DATA_BITS, write_record


class Store(wiring.Component):
    """Writes items of a fixed number of beats, each as one burst.

    Members
        i: stream of items and the beat that they begin at.
        writes: stream of `write_record`.

    **Timing**: a beat a cycle, latency 0. A path from `writes.ready` to `i.ready`.
    """

    def __init__(self, beats: int):
        self.beats = beats
        item = data.StructLayout({"beat": BEAT_ADDRESS_BITS, "data": beats * DATA_BITS})
        ports = {
            "i": In(stream.Signature(item)),
            "writes": Out(stream.Signature(layout(write_record()))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        number = Signal(range(max(self.beats, 2)))
        item, write = self.i.payload, self.writes.payload
        words = item.data.word_select(number, DATA_BITS)
        half = DATA_BITS // 2
        last = number == self.beats - 1
        m.d.comb += [
            self.writes.valid.eq(self.i.valid),
            write.beat.eq(item.beat),
            write.length.eq(self.beats - 1),
            write.strobe.eq(Const((1 << BEAT) - 1)),
            write.low.eq(words[:half]),
            write.high.eq(words[half:]),
            self.i.ready.eq(self.writes.ready & last),
        ]
        with m.If(self.writes.valid & self.writes.ready):
            m.d.sync += number.eq(number + 1)
            with m.If(last):
                m.d.sync += number.eq(0)
        return m
