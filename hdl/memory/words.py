"""Reads bursts of the machine's beats through a port with beats of double width."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.memory.axi import read_beat
from splatcore.spec.axi import DATA_BITS, port_beats, read_record
from splatcore.spec.config import Config

BURSTS_WAITING = 32  # bursts whose beats may be in flight


class Words(wiring.Component):
    """Reads bursts of the machine's beats, in order; each beat of the port is read once.

    If a burst begins with the upper half of the port's beat with which the previous burst ended, it
    takes that half from a register: neighbours share that beat. It does so only while the previous
    burst is awaited or output, so that no data is kept that memory may have changed since.

    Parameters:
        most: maximum length of a burst, beats

    **Timing**: one burst requested per cycle, one beat out per cycle, no latency. A path from
    `reads.ready` to `i.ready`, and one from `o.ready` to `data.ready`. No multiplier.
    """

    def __init__(self, config: Config, most: int):
        if port_beats(config) != 2:
            raise ValueError(f"port {config.port}: its beats are not two beats of the machine")
        self.burst = data.StructLayout({"upper": 1, "left": range(most), "kept": 1})
        self.waiting = Queue(self.burst, BURSTS_WAITING)
        ports = {
            "i": In(stream_of(read_record())),  # lengths in beats of the machine
            "o": Out(stream.Signature(DATA_BITS)),  # beats of the machine
            "reads": Out(stream_of(read_record())),  # to memory
            "data": In(stream.Signature(read_beat(config))),  # from memory
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.waiting = waiting = self.waiting
        busy = self._give(m, waiting.o)
        self._ask(m, waiting, busy)
        return m

    def _ask(self, m: Module, waiting: Queue, busy: Signal):
        """Request the port's beats of a burst, except one in flight for the previous burst."""
        i, reads, given = self.i, self.reads, waiting.i
        first, length = i.payload.beat, i.payload.length
        upper, end = first[0], Signal.like(i.payload.beat)  # the beat behind the burst before
        beats = (length + upper >> 1) + 1  # of the port
        kept, asks, taken = Signal(), Signal(), Signal()
        wanted = beats - kept
        m.d.comb += [
            kept.eq(upper & (first == end) & (waiting.o.valid | busy)),
            asks.eq(wanted != 0),
            reads.valid.eq(i.valid & given.ready & asks),
            reads.payload.beat.eq(Cat(Const(0, 1), first[1:] + kept)),
            reads.payload.length.eq((wanted - 1)[: len(length)]),
            taken.eq(i.valid & given.ready & (reads.ready | ~asks)),
            i.ready.eq(taken),
            given.valid.eq(taken),
            given.payload.upper.eq(upper),
            given.payload.left.eq(length),
            given.payload.kept.eq(kept),
        ]
        never_waits(m, "waiting", given, "a burst: BURSTS_WAITING")
        with m.If(taken):
            m.d.sync += end.eq(first + length + 1)

    def _give(self, m: Module, bursts: stream.Interface) -> Signal:
        """Output the beats burst by burst; return whether a burst is current."""
        busy, burst = Signal(), Signal(self.burst, reset_less=True)
        high, o, back = Signal(DATA_BITS, reset_less=True), self.o, self.data
        beat, fresh, fire = back.payload.beat, Signal(), Signal()
        m.d.comb += [
            fresh.eq(~burst.kept),  # the next beat is from the port
            o.valid.eq(busy & (~fresh | back.valid)),
            o.payload.eq(Mux(fresh, Mux(burst.upper, beat[DATA_BITS:], beat[:DATA_BITS]), high)),
            fire.eq(o.valid & o.ready),
            back.ready.eq(busy & fresh & o.ready),
            bursts.ready.eq(~busy | (fire & (burst.left == 0))),
        ]
        with m.If(fire):
            m.d.sync += [burst.left.eq(burst.left - 1), burst.upper.eq(~burst.upper)]
            m.d.sync += burst.kept.eq(fresh & ~burst.upper)
            with m.If(fresh):
                m.d.sync += high.eq(beat[DATA_BITS:])
        with m.If(bursts.ready):
            m.d.sync += [busy.eq(bursts.valid), burst.eq(bursts.payload)]
        return busy
