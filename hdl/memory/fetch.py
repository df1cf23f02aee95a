"""Reads ranges of memory beat by beat, through a queue, and cuts beats into slots."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.holds import holds, never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue, Stage, passes
from splatcore.hdl.memory.axi import read_beat
from splatcore.spec import axi
from splatcore.spec.config import Config
from splatcore.spec.group import ENTRY_BITS

RANGES_WAITING = 8  # ranges of slots whose beats may be in flight


class Fetch(wiring.Component):
    """Reads ranges of beats; returns the port's beats in order.

    A burst is requested when the queue has room for all of it in addition to the beats it holds and
    the beats in flight, so that arriving beats never wait. Bursts end at multiples of `burst`
    beats. The last burst's room is unused while the next one waits for room: short bursts hide more
    of the memory's latency, long bursts need fewer requests.

    Parameters:
        depth: beats of the machine that the queue holds
        count_bits: width of the number of beats of a range
        burst: beats of the machine per burst
        marks: whether ranges have a mark

    Internal:
        rest, sized, size: rest of the range; a burst waits to be requested; its beats

    **Timing**: one burst every two cycles, requested two cycles after its range or the previous
    burst was taken; on an FPGA one cycle more each. One beat per cycle, latency 2 through the
    queue. A queue that holds fewer beats than arrive during the memory's latency slows reading. No
    multiplier.
    """

    def __init__(
        self,
        config: Config,
        depth: int,
        count_bits: int,
        burst: int = axi.BURST_BEATS,
        marks: bool = False,
    ):
        if depth < burst:
            raise ValueError(f"a queue of {depth} beats, below a burst of {burst}")
        self.beats, self.logic = axi.port_beats(config), config.logic
        self.burst, self.depth = burst // self.beats, depth // self.beats  # of the port's
        self.range = layout(axi.range_record(count_bits))
        self.queue = Queue(config.port, self.depth, memory=True)
        name = "beats in the queue or in flight"
        self.used = Credit(self.depth, name, step=self.burst)
        self.rest, self.sized = Signal(self.range, reset_less=True), Signal()
        self.size = Signal(range(self.burst + 1), reset_less=True)
        ports = {
            "i": In(stream.Signature(self.range)),
            "reads": Out(stream_of(axi.read_record())),  # to the memory port
            "data": In(stream.Signature(read_beat(config))),  # from the memory port
            "o": Out(stream.Signature(config.port)),  # beats of the port
        }
        self.has_marks = marks
        if marks:
            ports["marks"] = In(1)  # mark of the range at `i`
            ports["marked"] = Out(1)  # mark of the burst at `reads`
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
        never_waits(m, "queue", queue.i, "a requested beat")
        # The rest of the range; the next burst.
        rest, more, sized, beats = self.rest, Signal(), self.sized, self.size
        asks = self.reads.payload
        burst = {k: Signal.like(asks[k], name=k, reset_less=True) for k in ("beat", "length")}
        below = exact_log2(self.beats)
        first, given = rest.beat[below:], self.i.payload
        offset = first[: exact_log2(self.burst)]
        to_boundary = Signal.like(beats)
        ends = rest.count <= to_boundary
        m.d.comb += [to_boundary.eq(self.burst - offset), self.i.ready.eq(~more)]
        m.d.comb += [asks[k].eq(value) for k, value in burst.items()]
        asked = Signal()
        m.d.comb += asked.eq(passes(self.reads))
        with m.If(~more):
            m.d.sync += [rest.beat.eq(given.beat), more.eq(self.i.valid)]
            m.d.sync += rest.count.eq((given.count + self.beats - 1) >> below)
        with m.Elif(~sized):
            length = Mux(ends, rest.count[: len(beats)], to_boundary)
            m.d.sync += [
                burst["beat"].eq(rest.beat),
                burst["length"].eq((length - 1)[: axi.LENGTH_BITS]),
                beats.eq(length),
                first.eq(Cat(Const(0, len(offset)), first[len(offset) :] + 1)),
                rest.count.eq(rest.count - to_boundary),
                more.eq(~ends),
            ]
        if self.has_marks:
            mark = Signal(reset_less=True)  # of the rest of the range
            with m.If(~more):
                m.d.sync += mark.eq(self.marks)
            with m.Elif(~sized):
                m.d.sync += self.marked.eq(mark)
        m.d.sync += sized.eq(Mux(sized, ~asked, more))
        m.submodules.used = used = self.used
        fits = sized & (used.count + beats <= self.depth)
        if self.logic == "fpga":  # registered; true until the burst is requested
            late = Signal()
            m.d.sync += late.eq(fits & ~asked)
            fits = late
        m.d.comb += [
            used.comes.eq(Mux(asked, beats, 0)),
            used.goes.eq(passes(self.o)),
            self.reads.valid.eq(fits),
        ]
        awaited = ~self.data.valid | (used.count != queue.level)
        holds(m, "awaited", awaited, "a beat has come that was not requested")
        return m


class Unpack(wiring.Component):
    """Cuts ranges of the port's beats into slots, the lowest slot of a beat first.

    Parameters:
        count_bits: width of the number of slots
        slot: bits per slot
        ranges: number of ranges that may wait for their beats

    **Timing**: one slot per cycle, latency 0 from a beat. A path from `o.ready` to `beats.ready`.
    """

    def __init__(
        self, config: Config, count_bits: int, slot: int = ENTRY_BITS, ranges: int = RANGES_WAITING
    ):
        self.slot = slot
        self.counts_waiting = Queue(count_bits, ranges) if ranges > 1 else Stage(count_bits)
        ports = {
            # the number of slots of each range, at least 1; the rest of a range's last beat is
            # dropped
            "counts": In(stream.Signature(count_bits)),
            "beats": In(stream.Signature(config.port)),  # the ranges' beats
            "o": Out(stream.Signature(slot)),  # slots
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.counts_waiting = waiting = self.counts_waiting
        connect(m, flipped(self).counts, waiting.i)
        beat, left = self.beats.payload, Signal.like(waiting.o.payload)  # 0: no range is current
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
    """Reads ranges of beats; returns the machine's beats in order: `Fetch`, and `Unpack` if the
    port's beats are wider.

    **Timing**: as `Fetch`.
    """

    def __init__(self, config: Config, depth: int, count_bits: int):
        self.config, self.fetch = config, Fetch(config, depth, count_bits)
        ports = {
            "i": In(stream_of(axi.range_record(count_bits))),
            "reads": Out(stream_of(axi.read_record())),  # to the memory port
            "data": In(stream.Signature(read_beat(config))),  # from the memory port
            "o": Out(stream.Signature(axi.DATA_BITS)),  # beats of the machine
        }
        super().__init__(ports)
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
        m.submodules.unpack = unpack = Unpack(self.config, self.count_bits, axi.DATA_BITS)
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
    """Connect `fetch` and `unpack` as a reader of ranges of slots in a component with `reads` and
    `data`.
    """
    m.submodules.fetch, m.submodules.unpack = fetch, unpack
    connect(m, fetch.reads, flipped(reader.reads))
    connect(m, flipped(reader.data), fetch.data)
    connect(m, fetch.o, unpack.beats)
