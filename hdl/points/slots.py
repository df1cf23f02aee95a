"""Slots in which points wait for their attributes: a ring in small memories."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect

from splatcore.hdl.arithmetic.convert import Convert, converted
from splatcore.hdl.lib.holds import holds, never_waits
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Queue, Register
from splatcore.hdl.points.codebook import FACTOR_BITS, INDEX_BITS
from splatcore.hdl.points.colour import BEATS, RAY, RAYS, STEPS
from splatcore.hdl.points.small import expanded
from splatcore.hdl.points.state import ModelState, codes
from splatcore.spec.colour import BASIS, LAYOUTS
from splatcore.spec.config import Config
from splatcore.spec.depth import low_format
from splatcore.spec.memory import ATTRIBUTE_BITS, SMALL_BITS
from splatcore.spec.point import PLACE_BITS, WANTED, point_record, projecting_record

POINT = ("x", "y", "z")


def parts(config: Config) -> dict[str, data.Layout]:
    """The parts of a slot, each in its own memory, so that each can be read at its own time."""
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
    """Holds points and requests their attributes; outputs slots whose attributes have come, in
    order.

    **Timing**: one point per cycle; no multiplier; memories of `Config.projection_slots` words.
    """

    def __init__(self, config: Config):
        self.config, self.parts = config, parts(config)
        self.beside = config.colours == "beside"
        self.slot = range(config.projection_slots)
        reading = data.StructLayout({"slot": self.slot, "enable": 1})
        ports = {
            "i": In(stream_of(point_record(config, "x y z"))),
            "chunks": In(stream_of(projecting_record())),  # taken with the chunk's last point
            "wanted": Out(stream_of(WANTED)),  # Gaussians whose attributes are to be read
            "attributes": In(stream.Signature(ATTRIBUTE_BITS)),  # their beats, in the same order
            "ready": Out(stream.Signature(self.slot)),  # slots that are complete
            "release": In(1),  # the oldest slot becomes free
            # the beat of two neighbours in a small model is requested once
            "model": In(ModelState),
            # {slot, enable} for each of `parts`
            "read": In(data.StructLayout(dict.fromkeys(self.parts, reading))),
            # the parts read, one cycle later; held until the next reading
            "found": Out(data.StructLayout(self.parts)),
        }
        if self.beside:
            address = range(BEATS * config.projection_slots)
            line = {"valid": 1, "address": address, "word": ATTRIBUTE_BITS}
            # {valid, address, word}, a beat behind a Gaussian's first, and its address in
            # `hdl.points.colour`
            ports["beat"] = Out(data.StructLayout(line))
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        # Slots from `oldest` to `entering` are in the array, those up to `filled` are complete,
        # those up to `free` wait. One extra bit distinguishes a full ring from an empty one.
        count = range(2 * self.config.projection_slots)
        oldest, entering, filled, free = (
            Signal(count, name=name) for name in ("oldest", "entering", "filled", "free")
        )
        point = self.i.payload
        push, taken = Signal(), Signal()
        room = (free - oldest)[: len(free)] != self.config.projection_slots
        enters = self.i.valid & self.chunks.valid & point.kept & room
        again = self._again(m, push)
        m.d.comb += [
            self.wanted.valid.eq(enters & ~again),
            push.eq(enters & (again | self.wanted.ready)),
            self.i.ready.eq(self.chunks.valid & (~point.kept | push)),
            self.chunks.ready.eq(self.i.valid & self.i.ready & point.last),
            self.ready.valid.eq(entering != filled),
            self.ready.payload.eq(entering),
        ]
        self._want(m)
        waits = self._waiting(m, push, again)
        attributes = self._taken(m, waits, taken, filled != free)
        beat, last = self._beats(m, waits, taken, filled) if self.beside else (Const(0), Const(1))
        if waits:
            m.d.comb += waits.o.ready.eq(taken & last)
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
        """The first beat of a Gaussian's attributes, and the number of beats."""
        place, chunk, wanted = self.i.payload.place, self.chunks.payload, self.wanted.payload
        count = Const(1)
        if self.beside:
            count = Signal(len(wanted.count))
            for number, one in enumerate(LAYOUTS):
                with m.If(chunk.harmonics == number):
                    m.d.comb += count.eq(1 + one.beats)
        before = sum(Mux(count[k], place << k, 0) for k in range(len(count)))
        first = chunk.attributes + before
        if self.config.small_models:
            first = Mux(self.model.small, first >> 1, first)
        m.d.comb += [wanted.beat.eq(first), wanted.count.eq(count)]

    def _again(self, m: Module, push: Value) -> Value:
        """High if the point's attributes are the upper half of the beat requested last."""
        if not self.config.small_models:
            return Const(0)
        point, asked, begun = self.i.payload, Signal(PLACE_BITS - 1), Signal()
        with m.If(self.i.valid & self.i.ready & point.last):
            m.d.sync += begun.eq(0)
        with m.Elif(push):
            m.d.sync += [begun.eq(1), asked.eq(point.place[1:])]
        return self.model.small & begun & (asked == point.place[1:])

    def _waiting(self, m: Module, push: Value, again: Value) -> Register | None:
        """Expected beats of the waiting Gaussians; None if all are alike."""
        fields = {"count": self.wanted.payload.count} if self.beside else {}
        if self.config.small_models:
            fields |= {"upper": self.i.payload.place[0], "again": again}
        if not fields:
            return None
        shape = data.StructLayout({name: len(value) for name, value in fields.items()})
        m.submodules.waiting = queue = Queue(shape, self.config.projection_slots, memory=True)
        m.submodules.next_waiting = register = Register(shape)  # cuts the path to `ready`
        connect(m, queue.o, register.i)
        m.d.comb += [queue.i.payload[name].eq(value) for name, value in fields.items()]
        m.d.comb += queue.i.valid.eq(push)
        never_waits(m, "waiting", queue.i, "a slot's number of beats")
        return register

    def _taken(self, m: Module, waits: Register | None, taken: Signal, owed: Value) -> Value:
        """Take a beat of the oldest waiting Gaussian, or the kept half of the previous beat.

        Returns the beat, or the expansion of the half.
        """
        whole, expected = self.attributes.payload, waits.o.valid if waits else owed
        if not self.config.small_models:
            m.d.comb += self.attributes.ready.eq(expected)
            m.d.comb += taken.eq(self.attributes.valid & expected)
            return whole
        of, high = waits.o.payload, Signal(SMALL_BITS, reset_less=True)
        m.d.comb += self.attributes.ready.eq(expected & ~of.again)
        m.d.comb += taken.eq(expected & (of.again | self.attributes.valid))
        with m.If(taken & ~of.again):
            m.d.sync += high.eq(whole[SMALL_BITS:])
        half = Mux(of.again, high, Mux(of.upper, whole[SMALL_BITS:], whole[:SMALL_BITS]))
        return Mux(self.model.small, expanded(half), whole)

    def _beats(
        self, m: Module, waits: Register, taken: Value, filled: Value
    ) -> tuple[Value, Value]:
        """Pass on the beats behind a Gaussian's first; return the number of the beat, and whether
        it is last.
        """
        beat, last = Signal(range(BEATS + 1)), Signal()
        m.d.comb += [
            last.eq(beat + 1 == waits.o.payload.count),
            self.beat.valid.eq(taken & (beat != 0)),
            self.beat.address.eq(Cat(beat[1], filled[:-1])),
            self.beat.word.eq(self.attributes.payload),
        ]
        with m.If(taken):
            m.d.sync += beat.eq(Mux(last, 0, beat + 1))
        return beat, last

    def _ray(self, m: Module) -> Value:
        """The point's ray in the slot's format."""
        rays, format = [self.i.payload[name] for name in RAY], self.config.arithmetic
        if not self.beside:
            return Cat(rays)
        return Cat(
            converted(m, f"convert_{name}", Convert(format, BASIS, 0), ray)
            for name, ray in zip(RAY, rays, strict=True)
        )

    def _memory(self, m: Module, name: str, write, slot, value):
        """A part's memory: written here, read through the ports."""
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
