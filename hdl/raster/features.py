"""Reads the features of sorted splats from memory, ahead of rasterizing."""

from amaranth.hdl import Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue, Register, passes, soon
from splatcore.hdl.memory.axi import read_beat
from splatcore.spec import group, raster
from splatcore.spec.axi import BEAT_ADDRESS_BITS, DATA_BITS, port_beats, read_record
from splatcore.spec.config import Config
from splatcore.spec.feature import feature_record

FEATURES_WAITING = 64  # features in flight or waiting, to hide the latency of memory
ENDS_WAITING = 8  # groups' ends among them


class Features(wiring.Component):
    """Adds their features to sorted splats, in the same order.

    A splat's feature is read once for all tiles of a group, unless it is known that none of its
    tiles has a live pixel any more.

    **Timing**: one splat per cycle, `FEATURES_WAITING` in flight.
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

    def elaborate(self, platform) -> Module:
        m = Module()
        order = data.StructLayout({"mask": self.config.group**2, "end": 1})
        depth = FEATURES_WAITING + ENDS_WAITING
        m.submodules.order = waiting = Queue(order, depth, memory=True)
        m.submodules.features = features = Queue(
            layout(feature_record(self.config)), FEATURES_WAITING, memory=True
        )
        m.submodules.reserved = reserved = Credit(FEATURES_WAITING, "features in flight or waiting")
        head = soon(m, "head", waiting.o, self.config.logic)
        m.submodules.ends = ends = Credit(depth + 1, "ends of groups inside")  # one at `head`
        taken = self._ask(m, waiting.i, reserved.room)
        self._collect(m, features.i, taken)
        m.d.comb += [
            reserved.comes.eq(taken),
            reserved.goes.eq(self._give(m, head, features.o)),
            ends.comes.eq(passes(self.i) & self.i.payload.end),
            ends.goes.eq(passes(self.o) & self.o.payload.end),
            self.known.eq(~ends.any),
            self.stop.eq(self.known & ~self.live.any()),
        ]
        return m

    def _ask(self, m: Module, order: stream.Interface, free: Value) -> Signal:
        """Request a splat's feature when there is room for it (`free`).

        Returns whether one is requested.
        """
        m.submodules.reads = register = Register(layout(read_record()))
        connect(m, register.o, flipped(self.reads))
        i, read, taken = self.i, register.i, Signal()
        room = free & order.ready
        drops = self.known & ~(i.payload.mask & self.live).any() & ~i.payload.end
        m.d.comb += [
            read.valid.eq(i.valid & ~i.payload.end & room & ~drops),
            read.payload.beat.eq(self.features_at + i.payload.splat),
            read.payload.narrow.eq(port_beats(self.config) > 1),
            taken.eq(read.valid & read.ready),
            order.payload.mask.eq(i.payload.mask),
            order.payload.end.eq(i.payload.end),
            order.valid.eq(taken | (i.valid & i.payload.end)),
            i.ready.eq(Mux(i.payload.end, order.ready, drops | (room & read.ready))),
        ]
        return taken

    def _collect(self, m: Module, features: stream.Interface, taken: Signal):
        """Store the feature, which is in the requested part of the beat; there is always room.

        taken: a feature is requested
        """
        beats = port_beats(self.config)
        part = 0
        if beats > 1:
            m.submodules.parts = parts = Queue(exact_log2(beats), FEATURES_WAITING, memory=True)
            m.d.comb += [
                parts.i.payload.eq(self.features_at + self.i.payload.splat),
                parts.i.valid.eq(taken),
                parts.o.ready.eq(self.data.valid),
            ]
            never_waits(m, "parts", parts.i, "a part of a beat: FEATURES_WAITING")
            part = parts.o.payload
        m.d.comb += [
            self.data.ready.eq(1),
            features.valid.eq(self.data.valid),
            features.payload.eq(self.data.payload.beat.word_select(part, DATA_BITS)),
        ]
        never_waits(m, "features", features, "a feature: FEATURES_WAITING")

    def _give(self, m: Module, order: stream.Interface, features: stream.Interface) -> Signal:
        """Output splats with their features; return whether one leaves."""
        o, given = self.o, Signal()
        end = order.payload.end
        m.d.comb += [
            o.valid.eq(order.valid & (end | features.valid)),
            o.payload.splat.eq(Mux(end, 0, features.payload)),
            o.payload.mask.eq(order.payload.mask),
            o.payload.end.eq(end),
            order.ready.eq(o.ready & (end | features.valid)),
            features.ready.eq(o.ready & order.valid & ~end),
            given.eq(features.valid & features.ready),
        ]
        return given
