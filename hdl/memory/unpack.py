"""Cuts beats of memory into slots of 8 bytes."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.memory.fetch import Fetch
from splatcore.spec.axi import DATA_BITS
from splatcore.spec.group import ENTRY_BITS

RANGES_WAITING = 8
"""Ranges whose beats may be on their way."""


class Unpack(wiring.Component):
    """Cuts ranges of beats into slots, the lower one of a beat first.

    Members
        counts: stream of how many slots each range has, at least 1. What a range's last beat holds
            beyond them is dropped.
        beats: stream of the ranges' beats.
        o: stream of slots.

    **Timing**: a slot a cycle, latency 0 from a beat. A path from `o.ready` to `beats.ready`.
    """

    def __init__(self, count_bits: int):
        self.counts_waiting = Queue(count_bits, RANGES_WAITING)
        super().__init__(
            {
                "counts": In(stream.Signature(count_bits)),
                "beats": In(stream.Signature(DATA_BITS)),
                "o": Out(stream.Signature(ENTRY_BITS)),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.counts_waiting = waiting = self.counts_waiting
        connect(m, flipped(self).counts, waiting.i)
        left, upper = Signal.like(waiting.o.payload), Signal()  # 0: none is at hand
        beat = self.beats.payload
        taken, last = Signal(), Signal()
        m.d.comb += [
            self.o.valid.eq(self.beats.valid & left.any()),
            self.o.payload.eq(Mux(upper, beat[ENTRY_BITS:], beat[:ENTRY_BITS])),
            taken.eq(self.o.valid & self.o.ready),
            last.eq(left == 1),
            self.beats.ready.eq(taken & (upper | last)),
            waiting.o.ready.eq(~left.any() | (taken & last)),
        ]
        with m.If(waiting.o.ready):
            m.d.sync += left.eq(Mux(waiting.o.valid, waiting.o.payload, 0))
        with m.Elif(taken):
            m.d.sync += left.eq(left - 1)
        with m.If(taken):
            m.d.sync += upper.eq(~upper & ~last)
        return m


def unpacked(
    m: Module, reader: wiring.Component, depth: int, range_bits: int, count_bits: int
) -> tuple[Fetch, Unpack]:
    """A reader of ranges of slots, for a component with the streams `reads` and `data`."""
    m.submodules.fetch = fetch = Fetch(depth, range_bits)
    m.submodules.unpack = unpack = Unpack(count_bits)
    connect(m, fetch.reads, flipped(reader.reads))
    connect(m, flipped(reader.data), fetch.data)
    connect(m, fetch.o, unpack.beats)
    return fetch, unpack
