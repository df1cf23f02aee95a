"""Slots in which points wait for their attributes: a ring in small memories."""

from amaranth.hdl import Cat, Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.points.array import codes
from splatcore.spec.config import Config
from splatcore.spec.memory import ATTRIBUTE_BITS, model_format
from splatcore.spec.point import GAUSSIAN_BITS, point_record, projecting_record

POINT = ("x", "y", "z")
RAY = ("ray_x", "ray_y", "ray_z")
FACTOR_BITS = model_format(Config(), 0).attribute_record.offset("colour0")
"""Bits of the attributes below the codebook indices: L and opacity."""


def parts(config: Config) -> dict[str, data.Layout | int]:
    """The parts of a slot, each in a memory of its own, to be read at a time of its own."""
    found = {
        "point": codes(config, POINT),
        "factor": data.ArrayLayout(1, FACTOR_BITS),
        "index": data.ArrayLayout(1, ATTRIBUTE_BITS - FACTOR_BITS),
    }
    return found | ({"ray": codes(config, RAY)} if config.sh_degree else {})


class Slots(wiring.Component):
    """Points in; their attributes asked for; slots whose attributes have come, in order, out.

    Members
        i: stream of `point_record` with x, y and z.
        chunks: stream of `projecting_record`, taken with the chunk's last point.
        wanted: stream of the numbers of Gaussians whose attributes are to be read.
        attributes: stream of these, in the same order.
        ready: stream of slots that are complete.
        release: the oldest slot is free again.
        read: for each of `parts` a slot and whether to read it; found: the answers a cycle later,
            which stay until the next reading.

    **Timing**: a point a cycle; no multiplier; memories of `Config.projection_slots` words.
    """

    def __init__(self, config: Config):
        self.config, self.parts = config, parts(config)
        self.slot = range(config.projection_slots)
        reading = data.StructLayout({"slot": self.slot, "enable": 1})
        ports = {
            "i": In(stream.Signature(layout(point_record(config, "x y z")))),
            "chunks": In(stream.Signature(layout(projecting_record()))),
            "wanted": Out(stream.Signature(GAUSSIAN_BITS)),
            "attributes": In(stream.Signature(ATTRIBUTE_BITS)),
            "ready": Out(stream.Signature(self.slot)),
            "release": In(1),
            "read": In(data.StructLayout(dict.fromkeys(self.parts, reading))),
            "found": Out(data.StructLayout(self.parts)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        # Slots from `oldest` to `entering` are in the array, from there to `filled` complete, from
        # there to `free` waiting. One more bit than a slot's number: a full ring is no empty one.
        count = range(2 * self.config.projection_slots)
        oldest, entering, filled, free = (
            Signal(count, name=name) for name in ("oldest", "entering", "filled", "free")
        )
        point, chunk = self.i.payload, self.chunks.payload
        room = (free - oldest)[: len(free)] != self.config.projection_slots
        m.d.comb += [
            self.wanted.valid.eq(self.i.valid & self.chunks.valid & point.kept & room),
            self.wanted.payload.eq(Cat(point.place, chunk.number)),
            self.i.ready.eq(self.chunks.valid & (~point.kept | (room & self.wanted.ready))),
            self.chunks.ready.eq(self.i.valid & self.i.ready & point.last),
            self.attributes.ready.eq(filled != free),
            self.ready.valid.eq(entering != filled),
            self.ready.payload.eq(entering),
        ]
        push, fill = Signal(), Signal()
        m.d.comb += push.eq(self.wanted.valid & self.wanted.ready)
        m.d.comb += fill.eq(self.attributes.valid & self.attributes.ready)
        for pointer, steps in (
            (free, push),
            (filled, fill),
            (entering, self.ready.valid & self.ready.ready),
            (oldest, self.release),
        ):
            with m.If(steps):
                m.d.sync += pointer.eq(pointer + 1)

        attributes = self.attributes.payload
        sources = {
            "point": (push, free, Cat(point[name] for name in POINT)),
            "factor": (fill, filled, attributes[:FACTOR_BITS]),
            "index": (fill, filled, attributes[FACTOR_BITS:]),
        }
        if "ray" in self.parts:
            sources["ray"] = (push, free, Cat(point[name] for name in RAY))
        for name, (write, slot, value) in sources.items():
            self._memory(m, name, write, slot, value)
        return m

    def _memory(self, m: Module, name: str, write, slot, value):
        """A part's memory: written in a slot, read as the outside says."""
        memory = Memory(shape=self.parts[name], depth=self.config.projection_slots, init=[])
        m.submodules[name] = memory
        write_port, read_port = memory.write_port(), memory.read_port()
        m.d.comb += [
            write_port.en.eq(write),
            write_port.addr.eq(slot),
            write_port.data.eq(value),
            read_port.en.eq(self.read[name].enable),
            read_port.addr.eq(self.read[name].slot),
            self.found[name].eq(read_port.data),
        ]
