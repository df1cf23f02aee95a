"""Slots in which points wait for their attributes: a ring in small memories."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.convert import Convert
from splatcore.hdl.lib.holds import holds, never_waits
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.points.array import codes
from splatcore.hdl.points.codebook import FACTOR_BITS, INDEX_BITS
from splatcore.hdl.points.colour import BEATS, RAY, RAYS, STEPS
from splatcore.spec.colour import BASIS, LAYOUTS
from splatcore.spec.config import Config
from splatcore.spec.depth import low_format
from splatcore.spec.memory import ATTRIBUTE_BITS
from splatcore.spec.point import WANTED, point_record, projecting_record

POINT = ("x", "y", "z")


def parts(config: Config) -> dict[str, data.Layout]:
    """The parts of a slot, each in a memory of its own, to be read at a time of its own."""
    low = {name: format.width for name, format in low_format(config).items()}
    found = {
        "point": codes(config, POINT),
        "depth": data.StructLayout({"z": config.arithmetic.width} | low),
        "factor": data.ArrayLayout(1, FACTOR_BITS),
        "index": data.ArrayLayout(1, INDEX_BITS),
    }
    if config.sh_degree:
        found["ray"] = RAYS if config.colours == "beside" else codes(config, RAY)
    return found | ({"steps": STEPS} if config.colours == "beside" else {})


class Slots(wiring.Component):
    """Points in; their attributes asked for; slots whose attributes have come, in order, out.

    Members
        i: stream of `point_record` with x, y and z.
        chunks: stream of `projecting_record`, taken with the chunk's last point.
        wanted: stream of `WANTED`: a Gaussian's attributes that are to be read.
        attributes: stream of their beats, in the same order.
        beat: {valid, address, word}: a beat behind a Gaussian's first, and its address in
            `hdl.points.colour`. Machines that make colours in the array have none.
        ready: stream of slots that are complete.
        release: the oldest slot is free again.
        read: for each of `parts` a slot and whether to read it; found: the answers a cycle later,
            which stay until the next reading.

    **Timing**: a point a cycle; no multiplier; memories of `Config.projection_slots` words.
    """

    def __init__(self, config: Config):
        self.config, self.parts = config, parts(config)
        self.beside = config.colours == "beside"
        self.slot = range(config.projection_slots)
        reading = data.StructLayout({"slot": self.slot, "enable": 1})
        ports = {
            "i": In(stream.Signature(layout(point_record(config, "x y z")))),
            "chunks": In(stream.Signature(layout(projecting_record()))),
            "wanted": Out(stream.Signature(layout(WANTED))),
            "attributes": In(stream.Signature(ATTRIBUTE_BITS)),
            "ready": Out(stream.Signature(self.slot)),
            "release": In(1),
            "read": In(data.StructLayout(dict.fromkeys(self.parts, reading))),
            "found": Out(data.StructLayout(self.parts)),
        }
        if self.beside:
            address = range(BEATS * config.projection_slots)
            line = {"valid": 1, "address": address, "word": ATTRIBUTE_BITS}
            ports["beat"] = Out(data.StructLayout(line))
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        # Slots from `oldest` to `entering` are in the array, from there to `filled` complete, from
        # there to `free` waiting. One more bit than a slot's number: a full ring is no empty one.
        count = range(2 * self.config.projection_slots)
        oldest, entering, filled, free = (
            Signal(count, name=name) for name in ("oldest", "entering", "filled", "free")
        )
        point = self.i.payload
        push, taken = Signal(), Signal()
        room = (free - oldest)[: len(free)] != self.config.projection_slots
        m.d.comb += [
            self.wanted.valid.eq(self.i.valid & self.chunks.valid & point.kept & room),
            self.i.ready.eq(self.chunks.valid & (~point.kept | (room & self.wanted.ready))),
            self.chunks.ready.eq(self.i.valid & self.i.ready & point.last),
            self.ready.valid.eq(entering != filled),
            self.ready.payload.eq(entering),
            push.eq(self.wanted.valid & self.wanted.ready),
            taken.eq(self.attributes.valid & self.attributes.ready),
        ]
        self._want(m)
        beat, last = Const(0), Const(1)
        if self.beside:
            beat, last = self._beats(m, push, taken, filled)
        else:
            m.d.comb += self.attributes.ready.eq(filled != free)
        freed = ~self.release | (oldest != entering)
        holds(m, "release", freed, "a slot is freed that is not in the array")
        first = taken & (beat == 0)
        for pointer, steps in (
            (free, push),
            (filled, taken & last),
            (entering, self.ready.valid & self.ready.ready),
            (oldest, self.release),
        ):
            with m.If(steps):
                m.d.sync += pointer.eq(pointer + 1)

        attributes = self.attributes.payload
        sources = {
            "point": (push, free, Cat(point[name] for name in POINT)),
            "depth": (push, free, Cat(point[name] for name in self.parts["depth"].members)),
            "factor": (first, filled, attributes[:FACTOR_BITS]),
            "index": (first, filled, attributes[FACTOR_BITS:]),
            "ray": (push, free, self._ray(m) if "ray" in self.parts else 0),
            "steps": (push, free, Cat(self.chunks.payload[name] for name in ("harmonics", "step"))),
        }
        for name in self.parts:
            self._memory(m, name, *sources[name])
        return m

    def _want(self, m: Module):
        """The first beat of a Gaussian's attributes and how many there are."""
        place, chunk, wanted = self.i.payload.place, self.chunks.payload, self.wanted.payload
        count = Const(1)
        if self.beside:
            count = Signal(len(wanted.count))
            for number, one in enumerate(LAYOUTS):
                with m.If(chunk.harmonics == number):
                    m.d.comb += count.eq(1 + one.beats)
        before = sum(Mux(count[k], place << k, 0) for k in range(len(count)))
        m.d.comb += [wanted.beat.eq(chunk.attributes + before), wanted.count.eq(count)]

    def _beats(self, m: Module, push: Value, taken: Value, filled: Value) -> tuple[Value, Value]:
        """The number of a Gaussian's beat, and whether it is its last; those behind the first go
        outside."""
        count = self.wanted.payload.count
        m.submodules.counts = counts = Queue(
            count.shape(), self.config.projection_slots, memory=True
        )
        beat, last = Signal(range(BEATS + 1)), Signal()
        m.d.comb += [
            counts.i.payload.eq(count),
            counts.i.valid.eq(push),
            self.attributes.ready.eq(counts.o.valid),
            last.eq(beat + 1 == counts.o.payload),
            counts.o.ready.eq(taken & last),
            self.beat.valid.eq(taken & (beat != 0)),
            self.beat.address.eq(Cat(beat[1], filled[:-1])),
            self.beat.word.eq(self.attributes.payload),
        ]
        never_waits(m, "counts", counts.i, "a slot's number of beats")
        with m.If(taken):
            m.d.sync += beat.eq(Mux(last, 0, beat + 1))
        return beat, last

    def _ray(self, m: Module) -> Value:
        """The point's ray in the slot's format."""
        rays = [self.i.payload[name] for name in RAY]
        if not self.beside:
            return Cat(rays)
        converted = []
        for name, ray in zip(RAY, rays, strict=True):
            m.submodules[f"convert_{name}"] = convert = Convert(self.config.arithmetic, BASIS, 0)
            m.d.comb += [convert.i.eq(ray), convert.enable.eq(1)]
            converted.append(convert.o)
        return Cat(converted)

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
