"""Unpacks stored positions and computes rays: vectors from the camera, in world axes."""

from amaranth.hdl import Array as Choice
from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, ValueLike
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.convert import FromFixed, ToFixed, converted
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Pipe
from splatcore.hdl.points.state import ModelState, codes, frame_state
from splatcore.spec import memory
from splatcore.spec.config import Config
from splatcore.spec.depth import finer
from splatcore.spec.frame import CAMERA
from splatcore.spec.number import Fixed
from splatcore.spec.point import AWAY, PLACE_BITS, culling_record
from splatcore.spec.schedule import POINT_CYCLES, point_cycles
from splatcore.spec.small import position_widths

BEAT = memory.ATTRIBUTE_BITS  # bits of a memory beat
WORD = 16  # bits by which a beat is shifted into the gearbox
CONVERT_LATENCY = 4  # cycles from grid steps to a float

AXES = ("ray_x", "ray_y", "ray_z")

GRID = Fixed(memory.ABSOLUTE.bias + 1, -memory.ABSOLUTE_EXPONENT, signed=True)
"""Absolute positions on their grid."""


class Position(wiring.Component):
    """Turns beats of stored positions into a ray for each point.

    The gearbox cuts the stream of beats into coordinates. Coordinates of a chunk lack their top
    bit: they are in the order of octants, so the bit follows from where the header says an octant
    ends. In small models their low bits are not stored either, and are zero. The vector from the
    camera to a point is exact on the grid and rounded once, to `spec.depth.finer`.

    **Timing**: one point every `spec.schedule.point_cycles` cycles, and one cycle more at each
    octant's end; latency `CONVERT_LATENCY` + 9 from a chunk's first beat.
    """

    def __init__(self, config: Config):
        self.config, self.fine = config, finer(config)
        self.widths = position_widths(config)
        ports = {
            # beats; a chunk begins at a new beat, and the rest of its last beat is dropped
            "i": In(stream.Signature(BEAT)),
            "chunk": In(layout(culling_record(config))),  # the chunk that the points belong to
            "chunk_valid": In(1),  # there is a chunk
            # the chunk is done; from the next cycle on `chunk` is the next one
            "next_chunk": In(1),
            "frame": In(frame_state(config)),
            "model": In(ModelState),
            "o": Out(stream.Signature(codes(self.fine, AXES))),  # rays, floats in scene units
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pipe = self.pipe = Pipe(CONVERT_LATENCY + 3)
        self.axis = Signal(range(len(AXES)))
        self.number, self.done = Signal(PLACE_BITS), Signal()
        self.ready = Signal()  # a coordinate may leave the gearbox
        coordinate = self._gearbox(m)
        if self.config.position == "chunk":
            point = self._offset(m, coordinate)
        else:
            [coordinate] = self._later(m, coordinate)
            m.d.comb += self.ready.eq(1)
            decode = ToFixed(memory.ABSOLUTE, GRID, 0)
            point = converted(m, "decode", decode, coordinate).as_signed()
        self._convert(m, point)
        self._count(m)
        self._collect(m)
        return m

    def _gearbox(self, m: Module) -> Value:
        """The next coordinate; `pipe.i` shows when it is valid and taken.

        A beat is taken as early as possible, but during the last point only if a coordinate lacks
        bits: no beat beyond a chunk's end is read. Machines with fewer than `POINT_CYCLES` also
        take one with the last word of the beat before, except of small models: there the bits
        before it can be all that the last point needs.
        """
        beat, words = Signal(BEAT, reset_less=True), Signal(range(BEAT // WORD + 1))
        bits, level = Signal(2 * WORD - 1), Signal(range(2 * WORD))
        active, left, rest = Signal(), Signal.like(level), Signal.like(bits)
        width = self._of_model(*self.widths)
        enough, last = level >= width, self.number + 1 == self.chunk.count
        takes = active & (words == 0) & (~enough | ~last)
        if point_cycles(self.config) < POINT_CYCLES:
            whole = self._of_model(Const(1), Const(0))
            takes |= active & (words == 1) & (left < WORD) & ~last & whole
        m.d.comb += [
            active.eq(self.chunk_valid & ~self.done),
            self.pipe.i.valid.eq(active & enough & self.ready),
            self.i.ready.eq(takes),
            left.eq(level),
            rest.eq(bits),
        ]
        taken = self.pipe.i.valid & self.pipe.i.ready
        with m.If(taken):
            m.d.comb += left.eq(level - width)
            m.d.comb += rest.eq(self._of_model(*(bits >> w for w in self.widths)))
        m.d.sync += [level.eq(left), bits.eq(rest)]
        with m.If((words != 0) & (left < WORD)):
            # Bits above the level are zero: zeros were shifted in.
            m.d.sync += bits.eq(rest | (beat[:WORD] << left[: (WORD - 1).bit_length()]))
            m.d.sync += [level.eq(left + WORD), beat.eq(beat >> WORD)]
            m.d.sync += words.eq(words - 1)
        with m.If(self.i.valid & self.i.ready):
            m.d.sync += [beat.eq(self.i.payload), words.eq(BEAT // WORD)]
        with m.If(self.next_chunk):
            m.d.sync += [words.eq(0), level.eq(0), bits.eq(0)]
        most = self.widths[0]
        return self._of_model(*(Cat(Const(0, most - w), bits[:w]) for w in self.widths))

    def _of_model(self, value: ValueLike, of_small: ValueLike | None = None) -> Value:
        """A value, or another one in small models."""
        return Value.cast(value) if of_small is None else Mux(self.model.small, of_small, value)

    def _offset(self, m: Module, coordinate: Value) -> Value:
        """The coordinate on the model's grid: top bit by the octant, shifted, from the origin."""
        octant, ends = Signal(range(memory.OCTANTS)), Choice(self.chunk.octant_end)
        at_end = (octant != memory.OCTANTS - 1) & (self.number == ends[octant]) & (self.axis == 0)
        m.d.comb += self.ready.eq(~at_end)
        with m.If(self.next_chunk):
            m.d.sync += octant.eq(0)
        with m.Elif(self.chunk_valid & ~self.done & at_end):
            m.d.sync += octant.eq(octant + 1)
        chunk = self.chunk
        # An expression, as some simulators evaluate a case only when one of its operands changes.
        top, shift, origin = self._of_axis(
            self.axis,
            *(Cat(octant[k], chunk.shift[k], chunk.origin[k]) for k in range(len(AXES))),
            widths=(1, len(chunk.shift[0]), len(chunk.origin[0])),
        )
        coordinate, top, shift, origin = self._later(m, coordinate, top, shift, origin)
        return origin.as_signed() + (Cat(coordinate, top) << shift)

    def _of_axis(self, axis: Value, *values: Value, widths: tuple[int, ...]) -> list[Value]:
        """The value of one axis, cut into parts."""
        x, y, z = values
        chosen, parts = Mux(axis == 0, x, Mux(axis == 1, y, z)), []
        for width in widths:
            parts.append(chosen[:width])
            chosen = chosen[width:]
        return parts

    def _later(self, m: Module, *values: Value) -> list[Signal]:
        """Values one step of the pipe later."""
        later = [Signal(value.shape(), reset_less=True, name="later") for value in values]
        with m.If(self.pipe.loads.any()):
            m.d.sync += [after.eq(value) for after, value in zip(later, values, strict=True)]
        return later

    def _convert(self, m: Module, point: Value):
        """From a coordinate on the grid to its offset from the camera, a float in scene units."""
        scale = range(-memory.EXPONENT_MAX, memory.EXPONENT_MAX + 1)
        format = self.fine.arithmetic
        m.submodules.convert = self.convert = FromFixed(AWAY, format, CONVERT_LATENCY, scale)
        [placed] = self._later(m, point)
        [axis] = self._later(m, *self._later(m, self.axis))
        [camera] = self._of_axis(axis, *self.frame.camera, widths=(CAMERA.width,))
        [way] = self._later(m, (placed - camera.as_signed())[: AWAY.width].as_signed())
        m.d.comb += [self.convert.i.eq(way), self.convert.scale.eq(self.model.position_exponent)]
        m.d.comb += self.convert.enable.eq(self.pipe.loads.any())

    def _count(self, m: Module):
        """Count coordinates and points of the chunk."""
        with m.If(self.pipe.i.valid & self.pipe.i.ready):
            m.d.sync += self.axis.eq(self.axis + 1)
            with m.If(self.axis == len(AXES) - 1):
                m.d.sync += [self.axis.eq(0), self.number.eq(self.number + 1)]
                m.d.sync += self.done.eq(self.number + 1 == self.chunk.count)
        with m.If(self.next_chunk):
            m.d.sync += [self.number.eq(0), self.done.eq(0)]

    def _collect(self, m: Module):
        """Combine three floats into a ray: two wait for the third."""
        first, second = (
            Signal(self.fine.arithmetic.width, name=name, reset_less=True) for name in AXES[:2]
        )
        have = Signal(range(len(AXES)))
        whole = have == len(AXES) - 1
        m.d.comb += self.o.valid.eq(whole & self.pipe.o.valid)
        m.d.comb += self.pipe.o.ready.eq(~whole | self.o.ready)
        m.d.comb += self.o.payload.eq(Cat(first, second, self.convert.o))
        with m.If(self.pipe.o.valid & self.pipe.o.ready):
            m.d.sync += have.eq(Mux(whole, 0, have + 1))
            with m.If(~whole):
                m.d.sync += [first.eq(second), second.eq(self.convert.o)]
