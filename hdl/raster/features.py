"""Reads the features of sorted splats from memory, ahead of rasterizing."""

from amaranth.hdl import Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue, Register, Stage, passes, soon
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.raster.recent import Recent
from splatcore.spec import group, raster
from splatcore.spec.axi import BEAT_ADDRESS_BITS, DATA_BITS, port_beats, read_record
from splatcore.spec.config import Config

WAITING = 62  # splats that wait for their features, to hide the latency of memory
ROWS = WAITING + 2  # beats in flight or waiting; one more splat waits behind the queue
KEPT = 64  # beats read before these in which features are found, if a beat has several


class Features(wiring.Component):
    """Adds their features to sorted splats, in the same order.

    A splat's feature is read once for all tiles of a group, unless it is known that none of its
    tiles has a live pixel any more. If a beat of the port holds two features, it is read once for
    both, should they be close in the order (`Recent`).

    **Timing**: one splat per cycle, `WAITING` in flight. Memories: a row per beat in flight,
    waiting or kept.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(stream_of(group.sorted_record(config))),
            "o": Out(stream_of(raster.featured_record(config))),
            "features_at": In(BEAT_ADDRESS_BITS),  # address of the features, in beats
            "live": In(config.group**2),  # tiles of the group at `o` that have live pixels
            # no tile of the group at `i`, which is the same group, has live pixels; its further
            # splats are dropped
            "stop": Out(1),
            "reads": Out(stream_of(read_record())),  # to memory
            "data": In(stream.Signature(read_beat(config))),  # from memory
        }
        super().__init__(ports)
        self.known = Signal()  # `live` is about the group at `i`
        self.kept = KEPT if port_beats(config) > 1 else 0
        self.rows = ROWS + self.kept
        self.recent = Recent(config, self.rows, self.kept)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.recent = self.recent
        waiting = {"mask": self.config.group**2, "end": 1, "new": 1}
        waiting |= {"row": exact_log2(self.rows), "part": exact_log2(port_beats(self.config))}
        m.submodules.order = order = Queue(data.StructLayout(waiting), WAITING, memory=True)
        head = soon(m, "head", order.o, self.config.logic)
        m.submodules.come = come = Credit(self.rows, "features that were asked for")
        m.submodules.ends = ends = Credit(WAITING + 4, "ends of groups inside")
        self._ask(m, order.i)
        m.d.comb += [
            come.comes.eq(self.data.valid),
            come.goes.eq(self._give(m, head, come.any)),
            ends.comes.eq(passes(self.i) & self.i.payload.end),
            ends.goes.eq(passes(self.o) & self.o.payload.end),
            self.known.eq(~ends.any),
            self.stop.eq(self.known & ~self.live.any()),
        ]
        return m

    def _ask(self, m: Module, order: stream.Interface):
        """Request a splat's beat, if it is new, when there is room for it."""
        m.submodules.reads = register = Register(layout(read_record()))
        connect(m, register.o, flipped(self.reads))
        i, seek, found, read = self.i, self.recent.i, self.recent.o, register.i
        one, new = found.payload.sorted, found.payload.new
        drops = self.known & ~(i.payload.mask & self.live).any() & ~i.payload.end
        m.d.comb += [
            seek.payload.eq(i.payload),
            seek.valid.eq(i.valid & ~drops),
            i.ready.eq(seek.ready | drops),
            read.valid.eq(found.valid & new & order.ready),
            read.payload.beat.eq(self.features_at + one.splat),
            order.valid.eq(found.valid & (read.ready | ~new)),
            found.ready.eq(order.ready & (read.ready | ~new)),
            order.payload.mask.eq(one.mask),
            order.payload.end.eq(one.end),
            order.payload.new.eq(new),
            order.payload.row.eq(found.payload.row),
            order.payload.part.eq(one.splat),
        ]

    def _give(self, m: Module, order: stream.Interface, come: Value) -> Value:
        """Output splats with their features; return whether one with a new beat goes.

        come: the beat of the first splat with a new one is there, and with it all beats before
        """
        m.submodules.beats = beats = Memory(shape=self.config.port, depth=self.rows, init=[])
        write, read, row = beats.write_port(), beats.read_port(), Signal(range(self.rows))
        m.d.comb += [self.data.ready.eq(1), write.en.eq(self.data.valid), write.addr.eq(row)]
        m.d.comb += write.data.eq(self.data.payload.beat)
        m.d.sync += row.eq(row + self.data.valid)
        m.submodules.out = out = Stage(order.payload.shape())
        o, goes, given, there = self.o, passes(out.i), out.o.payload, Signal()
        m.d.comb += [
            there.eq(come | ~order.payload.new),
            out.i.valid.eq(order.valid & there),
            out.i.payload.eq(order.payload),
            order.ready.eq(out.i.ready & there),
            read.addr.eq(order.payload.row),
            read.en.eq(goes),
            o.valid.eq(out.o.valid),
            out.o.ready.eq(o.ready),
            o.payload.splat.eq(Mux(given.end, 0, read.data.word_select(given.part, DATA_BITS))),
            o.payload.mask.eq(given.mask),
            o.payload.end.eq(given.end),
        ]
        return goes & order.payload.new
