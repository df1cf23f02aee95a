"""Reads ranges of memory beat by beat, through a queue, and cuts beats into slots of 8 bytes."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.memory.axi import read_beat
from splatcore.spec.axi import BEAT_ADDRESS_BITS, BURST_BEATS, DATA_BITS, LENGTH_BITS, read_record
from splatcore.spec.group import ENTRY_BITS

RANGES_WAITING = 8  # ranges of slots whose beats may be on their way


class Fetch(wiring.Component):
    """Ranges of beats in, the beats out, in order.

    A burst is asked for when the queue has room for all of it besides what it holds and what is on
    its way, so that beats that come back never wait. Bursts end at multiples of `burst` beats. The
    last burst's room is not used while the next one is waited for: short bursts hide more of the
    memory's latency, long ones ask less often.

    Members
        i: stream of ranges: first beat, count of beats (from 1 on).
        reads, data: to and from the memory port (`hdl.memory.axi`).
        o: stream of beats.

    **Timing**: a burst every 2 cycles, asked for 2 cycles after its range or the burst before was
    taken; a beat a cycle, latency 2 through the queue. Its memory has `depth` rows; one that holds
    fewer beats than come during the memory's latency slows the reading. No multiplier.
    """

    def __init__(self, depth: int, count_bits: int, burst: int = BURST_BEATS):
        if depth < burst:
            raise ValueError(f"a queue of {depth} beats, below a burst of {burst}")
        self.burst = burst
        self.range = data.StructLayout({"beat": BEAT_ADDRESS_BITS, "count": count_bits})
        self.depth, self.queue = depth, Queue(DATA_BITS, depth, memory=True)
        ports = {
            "i": In(stream.Signature(self.range)),
            "reads": Out(stream.Signature(layout(read_record()))),
            "data": In(stream.Signature(read_beat())),
            "o": Out(stream.Signature(DATA_BITS)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.queue = queue = self.queue
        connect(m, queue.o, flipped(self.o))
        m.d.comb += [
            queue.i.valid.eq(self.data.valid),
            queue.i.payload.eq(self.data.payload.beat),
            self.data.ready.eq(1),  # the queue has room
        ]
        # What is left of the range; the burst that is to be asked for.
        rest, more = Signal(self.range, reset_less=True), Signal()
        burst, sized = Signal(layout(read_record()), reset_less=True), Signal()
        beats = Signal(range(self.burst + 1), reset_less=True)
        offset = rest.beat[: exact_log2(self.burst)]
        to_boundary = Signal.like(beats)
        ends = rest.count <= to_boundary
        m.d.comb += [to_boundary.eq(self.burst - offset), self.i.ready.eq(~more)]
        m.d.comb += self.reads.payload.eq(burst)
        asked, fire = Signal(), Signal()
        m.d.comb += asked.eq(self.reads.valid & self.reads.ready)
        m.d.comb += fire.eq(self.o.valid & self.o.ready)
        with m.If(~more):
            m.d.sync += [rest.eq(self.i.payload), more.eq(self.i.valid)]
        with m.Elif(~sized):
            length = Mux(ends, rest.count[: len(beats)], to_boundary)
            m.d.sync += [
                burst.beat.eq(rest.beat),
                burst.length.eq((length - 1)[:LENGTH_BITS]),
                beats.eq(length),
                rest.beat.eq(Cat(Const(0, len(offset)), rest.beat[len(offset) :] + 1)),
                rest.count.eq(rest.count - to_boundary),
                more.eq(~ends),
            ]
        m.d.sync += sized.eq(Mux(sized, ~asked, more))
        # Beats in the queue or on their way to it.
        used = Signal(range(self.depth + 1))
        m.d.comb += self.reads.valid.eq(sized & (used + beats <= self.depth))
        m.d.sync += used.eq(used + Mux(asked, beats, 0) - fire)
        return m


class Unpack(wiring.Component):
    """Cuts ranges of beats into slots, the lower one of a beat first.

    Members
        counts: stream of how many slots each range has, at least 1. What a range's last beat holds
            beyond them is dropped.
        beats: stream of the ranges' beats.
        o: stream of slots.

    ranges: how many may wait whose beats have not come.

    **Timing**: a slot a cycle, latency 0 from a beat. A path from `o.ready` to `beats.ready`.
    """

    def __init__(self, count_bits: int, ranges: int = RANGES_WAITING):
        self.counts_waiting = Queue(count_bits, ranges)
        ports = {
            "counts": In(stream.Signature(count_bits)),
            "beats": In(stream.Signature(DATA_BITS)),
            "o": Out(stream.Signature(ENTRY_BITS)),
        }
        super().__init__(ports)

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


def unpacked(m: Module, reader: wiring.Component, fetch: Fetch, count_bits: int) -> Unpack:
    """A reader of ranges of slots, for a component with the streams `reads` and `data`."""
    m.submodules.fetch = fetch
    m.submodules.unpack = unpack = Unpack(count_bits)
    connect(m, fetch.reads, flipped(reader.reads))
    connect(m, flipped(reader.data), fetch.data)
    connect(m, fetch.o, unpack.beats)
    return unpack
