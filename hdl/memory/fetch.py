"""Reads ranges of memory beat by beat, through a queue, and cuts beats into slots."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.holds import holds, never_waits
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue, Stage, passes
from splatcore.hdl.memory.axi import read_beat
from splatcore.spec.axi import (
    BURST_BEATS,
    DATA_BITS,
    LENGTH_BITS,
    port_beats,
    range_record,
    read_record,
)
from splatcore.spec.config import Config
from splatcore.spec.group import ENTRY_BITS

RANGES_WAITING = 8  # ranges of slots whose beats may be on their way


class Fetch(wiring.Component):
    """Ranges of beats in, the port's beats out, in order.

    A burst is asked for when the queue has room for all of it besides what it holds and what is on
    its way, so that beats that come back never wait. Bursts end at multiples of `burst` beats. The
    last burst's room is not used while the next one is waited for: short bursts hide more of the
    memory's latency, long ones ask less often.

    Members
        i: stream of ranges (`range_record`).
        reads, data: to and from the memory port (`hdl.memory.axi`).
        o: stream of the port's beats.
        marks, marked: if there are marks: a bit of the range at `i`, and of that of the burst at
            `reads`.
        rest, sized, size: what is left of a range; a burst is to be asked for; its beats (for
            proofs).

    **Timing**: a burst every 2 cycles, asked for 2 cycles after its range or the burst before was
    taken; on an FPGA a cycle more each. A beat a cycle, latency 2 through the queue. Its memory has
    room for `depth` beats of the machine; one that holds fewer than come during the memory's
    latency slows the reading. No multiplier.
    """

    def __init__(
        self,
        config: Config,
        depth: int,
        count_bits: int,
        burst: int = BURST_BEATS,
        marks: bool = False,
    ):
        if depth < burst:
            raise ValueError(f"a queue of {depth} beats, below a burst of {burst}")
        self.beats, self.logic = port_beats(config), config.logic
        self.burst, self.depth = burst // self.beats, depth // self.beats  # of the port's
        self.range = layout(range_record(count_bits))
        self.queue = Queue(config.port, self.depth, memory=True)
        name = "beats in the queue or on their way to it"
        self.used = Credit(self.depth, name, step=self.burst)
        self.rest, self.sized = Signal(self.range, reset_less=True), Signal()
        self.size = Signal(range(self.burst + 1), reset_less=True)
        ports = {
            "i": In(stream.Signature(self.range)),
            "reads": Out(stream.Signature(layout(read_record()))),
            "data": In(stream.Signature(read_beat(config))),
            "o": Out(stream.Signature(config.port)),
        }
        self.has_marks = marks
        super().__init__(ports | ({"marks": In(1), "marked": Out(1)} if marks else {}))

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.queue = queue = self.queue
        connect(m, queue.o, flipped(self.o))
        m.d.comb += [
            queue.i.valid.eq(self.data.valid),
            queue.i.payload.eq(self.data.payload.beat),
            self.data.ready.eq(1),  # the queue has room
        ]
        never_waits(m, "queue", queue.i, "a beat that was asked for")
        # What is left of the range; the burst that is to be asked for.
        rest, more, sized, beats = self.rest, Signal(), self.sized, self.size
        asks = self.reads.payload
        burst = {k: Signal.like(asks[k], name=k, reset_less=True) for k in ("beat", "length")}
        below = exact_log2(self.beats)
        first, given = rest.beat[below:], self.i.payload
        offset = first[: exact_log2(self.burst)]
        to_boundary = Signal.like(beats)
        ends = rest.count <= to_boundary
        m.d.comb += [to_boundary.eq(self.burst - offset), self.i.ready.eq(~more)]
        m.d.comb += [asks[k].eq(value) for k, value in burst.items()]  # never narrow
        asked = Signal()
        m.d.comb += asked.eq(passes(self.reads))
        with m.If(~more):
            m.d.sync += [rest.beat.eq(given.beat), more.eq(self.i.valid)]
            m.d.sync += rest.count.eq((given.count + self.beats - 1) >> below)
        with m.Elif(~sized):
            length = Mux(ends, rest.count[: len(beats)], to_boundary)
            m.d.sync += [
                burst["beat"].eq(rest.beat),
                burst["length"].eq((length - 1)[:LENGTH_BITS]),
                beats.eq(length),
                first.eq(Cat(Const(0, len(offset)), first[len(offset) :] + 1)),
                rest.count.eq(rest.count - to_boundary),
                more.eq(~ends),
            ]
        if self.has_marks:
            mark = Signal(reset_less=True)  # of what is left of the range
            with m.If(~more):
                m.d.sync += mark.eq(self.marks)
            with m.Elif(~sized):
                m.d.sync += self.marked.eq(mark)
        m.d.sync += sized.eq(Mux(sized, ~asked, more))
        m.submodules.used = used = self.used
        fits = sized & (used.count + beats <= self.depth)
        if self.logic == "fpga":  # known a cycle later, and true until it is asked for
            late = Signal()
            m.d.sync += late.eq(fits & ~asked)
            fits = late
        m.d.comb += [
            used.comes.eq(Mux(asked, beats, 0)),
            used.goes.eq(passes(self.o)),
            self.reads.valid.eq(fits),
        ]
        awaited = ~self.data.valid | (used.count != queue.level)
        holds(m, "awaited", awaited, "a beat has come that was not asked for")
        return m


class Unpack(wiring.Component):
    """Cuts ranges of the port's beats into slots, the lowest one of a beat first.

    Members
        counts: stream of how many slots each range has, at least 1. What a range's last beat holds
            beyond them is dropped.
        beats: stream of the ranges' beats.
        o: stream of slots.

    slot: bits of one; ranges: how many may wait whose beats have not come.

    **Timing**: a slot a cycle, latency 0 from a beat. A path from `o.ready` to `beats.ready`.
    """

    def __init__(
        self, config: Config, count_bits: int, slot: int = ENTRY_BITS, ranges: int = RANGES_WAITING
    ):
        self.slot = slot
        self.counts_waiting = Queue(count_bits, ranges) if ranges > 1 else Stage(count_bits)
        ports = {
            "counts": In(stream.Signature(count_bits)),
            "beats": In(stream.Signature(config.port)),
            "o": Out(stream.Signature(slot)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.counts_waiting = waiting = self.counts_waiting
        connect(m, flipped(self).counts, waiting.i)
        beat, left = self.beats.payload, Signal.like(waiting.o.payload)  # 0: none is at hand
        place = Signal(range(len(beat) // self.slot))
        taken, last = Signal(), Signal()
        m.d.comb += [
            self.o.valid.eq(self.beats.valid & left.any()),
            self.o.payload.eq(beat.word_select(place, self.slot)),
            taken.eq(self.o.valid & self.o.ready),
            last.eq(left == 1),
            self.beats.ready.eq(taken & (place.all() | last)),
            waiting.o.ready.eq(~left.any() | (taken & last)),
        ]
        with m.If(waiting.o.ready):
            m.d.sync += left.eq(Mux(waiting.o.valid, waiting.o.payload, 0))
        with m.Elif(taken):
            m.d.sync += left.eq(left - 1)
        with m.If(taken):
            m.d.sync += place.eq(Mux(last, 0, place + 1))
        return m


class FetchBeats(wiring.Component):
    """Ranges of beats in, the machine's beats out, in order: `Fetch`, and `Unpack` if the port's
    beats are larger.

    Members: those of `Fetch`; o: stream of the machine's beats.

    **Timing**: that of `Fetch`.
    """

    def __init__(self, config: Config, depth: int, count_bits: int):
        self.config, self.fetch = config, Fetch(config, depth, count_bits)
        ports = dict(self.fetch.signature.members)
        super().__init__(ports | {"o": Out(stream.Signature(DATA_BITS))})
        self.count_bits = count_bits

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.fetch = fetch = self.fetch
        outside = flipped(self)
        connect(m, fetch.reads, outside.reads)
        connect(m, outside.data, fetch.data)
        if fetch.beats == 1:
            connect(m, outside.i, fetch.i)
            connect(m, fetch.o, outside.o)
            return m
        m.submodules.unpack = unpack = Unpack(self.config, self.count_bits, DATA_BITS)
        connect(m, fetch.o, unpack.beats)
        connect(m, unpack.o, outside.o)
        m.d.comb += [  # a range goes to both at once
            fetch.i.payload.eq(self.i.payload),
            fetch.i.valid.eq(self.i.valid & unpack.counts.ready),
            unpack.counts.payload.eq(self.i.payload.count),
            unpack.counts.valid.eq(self.i.valid & fetch.i.ready),
            self.i.ready.eq(fetch.i.ready & unpack.counts.ready),
        ]
        return m


def unpacked(m: Module, reader: wiring.Component, fetch: Fetch, unpack: Unpack):
    """A reader of ranges of slots, for a component with the streams `reads` and `data`."""
    m.submodules.fetch, m.submodules.unpack = fetch, unpack
    connect(m, fetch.reads, flipped(reader.reads))
    connect(m, flipped(reader.data), fetch.data)
    connect(m, fetch.o, unpack.beats)
