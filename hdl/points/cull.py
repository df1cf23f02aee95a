"""Stage 0: computes each point's depth and culls it at the near plane."""

from amaranth.hdl import Const, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect

from splatcore.hdl.arithmetic.compare import compared
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Slot, judged
from splatcore.hdl.points.array import Array
from splatcore.hdl.points.depth import narrowed, widened
from splatcore.hdl.points.position import AXES, BEAT, Position
from splatcore.hdl.points.state import ModelState, frame_state
from splatcore.spec.config import Config
from splatcore.spec.depth import finer, low_bits
from splatcore.spec.microprogram import culling
from splatcore.spec.point import PLACE_BITS, culling_record, point_record


class Cull(wiring.Component):
    """Reads the points of the chunks that are kept; passes on the points in front of the near
    plane.

    Numbers inside have the formats of `spec.depth.finer`.

    **Timing**: one PE, one point every 4 cycles, or 3 (`spec.schedule.point_cycles`), latency
    about 30. No path from `o` to `positions`.
    """

    def __init__(self, config: Config):
        self.config, self.program = config, culling(config.depth_interval)
        self.fine = finer(config)
        ports = {
            "chunks": In(stream_of(culling_record(config))),  # taken with the chunk's last point
            "positions": In(stream.Signature(BEAT)),  # memory beats (`hdl.points.position`)
            "frame": In(frame_state(config)),
            "model": In(ModelState),
            "o": Out(stream_of(point_record(config, "z"))),  # with z and z_low
            "taken": Out(1),  # a point has been read, high for one cycle
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        carried = data.StructLayout({"place": PLACE_BITS, "last": 1})
        m.submodules.position = position = Position(self.config)
        m.submodules.array = array = Array(self.fine, self.program, carried=carried)

        number, chunk = Signal(PLACE_BITS), self.chunks.payload
        last = number + 1 == chunk.count
        m.d.comb += [
            position.i.valid.eq(self.positions.valid),
            position.i.payload.eq(self.positions.payload),
            self.positions.ready.eq(position.i.ready),
            position.chunk.eq(chunk),
            position.frame.eq(self.frame),
            position.model.eq(self.model),
            position.chunk_valid.eq(self.chunks.valid),
            position.next_chunk.eq(self.taken & last),
            self.chunks.ready.eq(self.taken & last),
            array.i.valid.eq(position.o.valid),
            position.o.ready.eq(array.i.ready),
            self.taken.eq(array.i.valid & array.i.ready),
            array.i.payload.carried.place.eq(number),
            array.i.payload.carried.last.eq(last),
        ]
        for name in self.program.constants:
            m.d.comb += array.constants[name].eq(widened(self.config, self.frame.constants[name]))
        for name in self.program.fields:
            ray, field = name in AXES, array.i.payload.fields[name]
            source = position.o.payload[name] if ray else widened(self.config, chunk[name])
            m.d.comb += field.eq(source)
        with m.If(self.taken):
            m.d.sync += number.eq(Mux(last, 0, number + 1))

        m.submodules.whole = whole = Slot(array.o.payload.shape())
        connect(m, array.o, whole.i)
        found, through = whole.o.payload.outputs, whole.o.payload.carried
        depth = found.farthest if self.config.depth_interval else found.z
        near = widened(self.config, self.frame.near_plane)
        compare = compared(m, "compare", self.fine.arithmetic, near, depth)
        keep = Const(1, 1) if self.config.culling == "none" else compare.less
        kept, known = judged(m, whole.o, keep)
        passes = kept | through.last
        m.d.comb += [
            self.o.valid.eq(known & passes),
            whole.o.ready.eq(known & (self.o.ready | ~passes)),
            self.o.payload.kept.eq(kept),
            self.o.payload.place.eq(through.place),
            self.o.payload.last.eq(through.last),
        ]
        for name in ("z", *AXES):
            m.d.comb += self.o.payload[name].eq(narrowed(self.config, found[name]))
        if bits := low_bits(self.config):
            m.d.comb += self.o.payload.z_low.eq(found.z[:bits])
        return m
