"""Front of stage 1: computes x and y of the points that stage 0 kept, drops those out of view."""

from amaranth.hdl import Const, Module, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.compare import compared
from splatcore.hdl.lib.holds import holds, never_waits
from splatcore.hdl.lib.record import same_fields, stream_of
from splatcore.hdl.lib.stream import Queue, Slot, judged
from splatcore.hdl.points.array import Array
from splatcore.hdl.points.position import AXES
from splatcore.hdl.points.state import frame_state
from splatcore.spec.config import Config
from splatcore.spec.microprogram import program
from splatcore.spec.point import placing_record, point_record

SPARE = 2  # rows of the memory beyond the array's capacity, for its latency


class Place(wiring.Component):
    """Passes on the points that may touch the image, with their x and y.

    A point waits in a small memory while the array computes its x and y.

    **Timing**: two PEs, one point every 4 cycles, or three PEs and 3 cycles
    (`spec.schedule.point_cycles`); latency about 20. No path from `o` to `i`.
    """

    def __init__(self, config: Config):
        self.config, self.program = config, program("place")
        ports = {
            "i": In(stream_of(point_record(config, "z"))),
            "chunks": In(stream_of(placing_record(config))),  # taken with the chunk's last point
            "frame": In(frame_state(config)),
            "o": Out(stream_of(point_record(config, "x y z"))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.array = array = Array(self.config, self.program)
        shape = self.i.payload.shape()
        m.submodules.points = points = Queue(shape, array.round_count + SPARE, memory=True)
        point, chunk = self.i.payload, self.chunks.payload
        m.d.comb += [
            array.i.valid.eq(self.i.valid & self.chunks.valid),
            self.i.ready.eq(array.i.ready & self.chunks.valid),
            self.chunks.ready.eq(self.i.valid & array.i.ready & point.last),
            *same_fields(array.constants, self.frame.constants),
            points.i.valid.eq(array.i.valid & array.i.ready),
            points.i.payload.eq(point),
            points.o.ready.eq(array.o.valid & array.o.ready),
        ]
        whole = {"found": array.o.payload.outputs.shape(), "through": shape}
        m.submodules.whole = whole = Slot(data.StructLayout(whole))
        m.d.comb += [
            whole.i.valid.eq(array.o.valid),
            array.o.ready.eq(whole.i.ready),
            whole.i.payload.found.eq(array.o.payload.outputs),
            whole.i.payload.through.eq(points.o.payload),
        ]
        for name in self.program.fields:
            source = point if name in ("z", *AXES) else chunk
            m.d.comb += array.i.payload.fields[name].eq(source[name])

        never_waits(m, "points", points.i, "a point that enters the array")
        known = ~array.o.valid | points.o.valid
        holds(m, "known", known, "a result of the array without a waiting point")
        found, through = whole.o.payload.found, whole.o.payload.through
        kept, known = judged(m, whole.o, through.kept & self._inside(m, found, through.z))
        passes = kept | through.last
        m.d.comb += [
            self.o.valid.eq(known & passes),
            whole.o.ready.eq(known & (self.o.ready | ~passes)),
            *(self.o.payload[name].eq(through[name]) for name in shape.members),
            self.o.payload.kept.eq(kept),
            *(self.o.payload[name].eq(found[name]) for name in "xy"),
        ]
        return m

    def _inside(self, m: Module, found: data.View, z: Value):
        """High if the centre is in front of the near plane, and |x| and |y| are within their
        bounds.

        With a depth interval stage 0 passes points whose centre is behind the near plane.
        """
        if self.config.culling == "none":
            return Const(1, 1)
        format = self.config.arithmetic
        magnitude = (1 << (format.width - 1)) - 1
        inside = compared(m, "compare_z", format, self.frame.near_plane, z).less
        for axis in "xy" if self.config.culling == "all" else "":
            size, bound = found[axis] & magnitude, found[f"bound_{axis}"]
            compare = compared(m, f"compare_{axis}", format, size, bound)
            inside &= compare.less | compare.equal
        return inside
