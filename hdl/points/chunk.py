"""Front of stage 0: values that a chunk's points share, and skipping of chunks out of view."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.compare import compared
from splatcore.hdl.arithmetic.convert import Convert, FromFixed, converted
from splatcore.hdl.lib.record import layout, same_fields, stream_of
from splatcore.hdl.lib.stream import judged
from splatcore.hdl.points.array import Array
from splatcore.hdl.points.level import BEATS_BITS, Level, level_ports
from splatcore.hdl.points.state import ModelState, frame_state
from splatcore.spec import microprogram, point, programs
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import Config
from splatcore.spec.levels import LEVEL, WIDER_BITS
from splatcore.spec.memory import CHUNK, CHUNK_HEADER, EXPONENT_MAX, EXTENT_SHIFT, REACH
from splatcore.spec.programs import CORNER_STEPS

AXES = "xyz"

CONVERT_LATENCY = 4  # cycles from grid steps to a float


def _chosen(chosen: Value, values: data.View) -> Value:
    """The bits of the value selected by a one-hot `chosen`; 0 if that is 0."""
    found = Const(0)
    for one, value in zip(chosen, values, strict=True):
        bits = Value.cast(value).as_unsigned()
        found |= bits & one.replicate(len(bits))
    return found


class Chunk(wiring.Component):
    """Passes on the chunks that may contain something visible, with the values that their points
    share.

    A chunk is skipped if the bounds of its points are behind the near plane or beyond the guard
    band (`spec.programs.CHUNK`): none of its points will be read. Absolute positions have no
    bounds; then no chunk is skipped.

    With `Config.levels` it also chooses levels (`hdl.points.level`). A record is tested like a
    header: its sphere's centre replaces both ends, and its radius and `around` the reaches. With
    other constants far_x is the largest error, and far_y how far its Gaussians reach along x
    (`spec.programs.LEVEL`).

    **Timing**: one PE; a header every `plan.length` + 17 cycles (`DEFAULT`: 40, while the points of
    a full chunk take 1024). One header at a time, so its numbers need not be carried along. A
    record that is tested takes as long as a header.
    """

    def __init__(self, config: Config):
        self.config, self.program = config, microprogram.program("chunk")
        ports = {
            "i": In(stream_of(CHUNK_HEADER)),  # in the order of the model
            "frame": In(frame_state(config)),
            # with the last chunk a frame ends, and the next header belongs to chunk 0
            "model": In(ModelState),
            "o": Out(stream_of(point.chunk_record(config))),
            "taken": Out(1),  # a header of a drawn level is done, kept or skipped, for one cycle
        }
        super().__init__(ports | level_ports(config.levels))

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.array = self.array = Array(self.config, self.program, held=True)
        self.number = Signal(point.NUMBER_BITS)
        # Beats of attributes of all earlier chunks, over CHUNK: only a model's last has fewer.
        self.beats = Signal(BEATS_BITS)
        self.headers = self._levels(m) if self.config.levels else self.i
        self._run(m, *self._converted(m))
        self._give(m)
        return m

    def _levels(self, m: Module) -> stream.Interface:
        """Headers that the view draws, and records to be tested."""
        m.submodules.level = level = self.level = Level()
        connect(m, flipped(self).i, level.i)
        m.d.comb += [
            level.levels.eq(self.levels),
            level.number.eq(self.number),
            level.last.eq(self._last()),
            level.turn.eq(self.turn),
            self.fault.eq(level.fault),
            self.jump.eq(level.jump),
            self.target.eq(level.target),
        ]
        return level.o

    def _header(self, value: Value) -> Value:
        """A value that is 0 while a record is tested."""
        return value & ~self.level.tests if self.config.levels else value

    def _converted(self, m: Module) -> tuple[Value, list[Signal], list[Signal]]:
        """The chunk's two ends along each world axis as floats, converted one after the other.

        Returns a bit (all are converted), the low ends and the high ends.
        """
        header, format = self.headers.payload, self.config.arithmetic
        scale = range(-EXPONENT_MAX, EXPONENT_MAX + 1)
        m.submodules.convert = convert = FromFixed(point.AWAY, format, CONVERT_LATENCY, scale)
        way = Signal(signed(point.AWAY.width))
        # One-hot: a step for each axis of the low ends, then of the high ends, then the steps that
        # the converter takes.
        step = Signal(2 * len(AXES) + CONVERT_LATENCY + 2, init=1)
        low_ends, high_ends = step[: len(AXES)], step[len(AXES) :][: len(AXES)]
        done = step[-1]
        high = step[len(AXES) + CONVERT_LATENCY + 1 :].any()  # the converter outputs a high end
        origin = _chosen(low_ends | high_ends, header.origin).as_signed()
        spans = Cat(self._header(one) for one in high_ends)  # the ends of records are the same
        eye = _chosen(low_ends | high_ends, self.frame.camera).as_signed()
        # The largest offset with this extent is below the smallest offset with the next extent.
        end = (_chosen(spans, header.extent) + spans.any()) << EXTENT_SHIFT
        span = (end << _chosen(high_ends, header.shift))[: point.AWAY.width]
        m.d.sync += way.eq(origin + span - eye)
        m.d.comb += [convert.i.eq(way), convert.enable.eq(1)]
        m.d.comb += convert.scale.eq(self.model.position_exponent)
        values = [
            Signal(format.width, name=f"{end}_{axis}", reset_less=True)
            for end in ("low", "high")
            for axis in AXES
        ]
        with m.If(~done & self.headers.valid):
            m.d.sync += step.eq(step << 1)
            comes = self._outward(convert.o, high)
            m.d.sync += [a.eq(b) for a, b in zip(values, [*values[1:], comes], strict=True)]
        with m.If(self.array.o.ready):
            m.d.sync += step.eq(1)
        return done, values[: len(AXES)], values[len(AXES) :]

    def _outward(self, code: Value, up: Value) -> Value:
        """A code moved `CORNER_STEPS` codes up or down, unless it is at an end of the format."""
        size, exponent = code[:-1], code[self.config.arithmetic.fraction : -1]
        inside, bits = exponent.any() & ~exponent[1:].all(), CORNER_STEPS.bit_length() - 1
        inside = self._header(inside)
        grows = code[-1] != up
        moved = size[bits:] + Mux(grows, 1, -1)
        return Cat(size[:bits], Mux(inside, moved[: len(size) - bits], size[bits:]), code[-1])

    def _run(self, m: Module, done: Value, low: list, high: list):
        """Run the header's numbers through the array once."""
        fields, inside = self.array.i.payload.fields, Signal()
        reach = Convert(REACH, self.config.arithmetic, 0)
        m.d.comb += [
            fields.chunk_reach.eq(converted(m, "reach", reach, self.headers.payload.reach)),
            fields.reach_y.eq(fields.chunk_reach),
            self.array.i.valid.eq(done & ~inside),
        ]
        for name, (constant, side) in programs.CORNERS.items():
            falls, axis = self.frame.constants[constant][-1], int(name[-1])
            least, most = Mux(falls, high[axis], low[axis]), Mux(falls, low[axis], high[axis])
            m.d.comb += fields[name].eq(least if side == "least" else most)
        with m.If(self.array.i.valid & self.array.i.ready):
            m.d.sync += inside.eq(1)
        with m.If(self.array.o.ready):
            m.d.sync += inside.eq(0)
        m.d.comb += same_fields(self.array.constants, self.frame.constants)
        if self.config.levels:
            given, constants = self.frame.constants, self.array.constants
            format = self.config.arithmetic
            wide, convert = 1 << format.fraction - WIDER_BITS, Convert(REACH, format, 0)
            around = converted(m, "around", convert, self._record().around)
            with m.If(self.level.tests):
                m.d.comb += [
                    fields.reach_y.eq(around),
                    constants.guard_x.eq(given.lod),
                    constants.spread_x.eq(Cat(given.lod[:-1], 1)),
                    constants.guard_y.eq(given.guard_x + wide),
                    constants.spread_y.eq(given.surround),
                ]

    def _record(self) -> data.View:
        """The item at the input as a record of levels."""
        return data.View(layout(LEVEL), Value.cast(self.headers.payload))

    def _give(self, m: Module):
        """Decide whether to keep the chunk, and pass it on."""
        header, found, payload = self.headers.payload, self.array.o.payload.outputs, self.o.payload
        kept, known = judged(m, self.array.o, self._keep(m, found))
        gaussians = self.model.gaussians
        last = self.number == self._last()
        whole = self.number != gaussians[CHUNK.bit_length() - 1 :]
        count = Mux(whole, CHUNK, gaussians[: CHUNK.bit_length() - 1])
        m.d.comb += [
            self.o.valid.eq(self._header(known & kept)),
            self.array.o.ready.eq(known & (self.o.ready | ~self._header(kept))),
            self.headers.ready.eq(self.array.o.ready),
            payload.culling.count.eq(count),
            payload.fetch.number.eq(self.number),
            payload.fetch.count.eq(count),
            payload.projecting.attributes.eq(self.beats << point.PLACE_BITS),
            payload.projecting.harmonics.eq(header.harmonics),
            payload.projecting.step.eq(header.step),
        ]
        m.d.comb += self.taken.eq(self._header(self.array.o.ready))
        over = self.taken
        if self.config.levels:
            over |= self.level.dropped
            m.d.comb += self.level.enough.eq(kept)
        for part in payload.shape().members:
            fields = payload[part]
            for name in fields.shape().members:
                if name in self.program.outputs:
                    m.d.comb += fields[name].eq(found[name])
                elif name in self.program.fields:
                    m.d.comb += fields[name].eq(self.array.i.payload.fields[name])
        if self.config.position == "chunk":
            for name in ("origin", "shift", "octant_end"):
                m.d.comb += payload.culling[name].eq(header[name])
        beats = Cat(Const(1 + harmonics.beats, 2) for harmonics in LAYOUTS)
        each = beats.word_select(header.harmonics, 2)
        with m.If(over):
            m.d.sync += self.number.eq(Mux(last, 0, self.number + 1))
            m.d.sync += self.beats.eq(Mux(last, 0, self.beats + each))
        if self.config.levels:
            level = self.level
            with m.If(over & level.over):
                ends = level.end == self._last()
                m.d.sync += self.number.eq(Mux(ends, 0, level.target))
                m.d.sync += self.beats.eq(Mux(ends, 0, level.beats))

    def _last(self) -> Value:
        """Number of the model's last chunk."""
        return (self.model.gaussians - 1)[CHUNK.bit_length() - 1 :]

    def _keep(self, m: Module, found: data.View) -> Value:
        """High if the chunk is kept, or if the tested group is coarse enough."""
        bounds, format = self._bounds(m, found), self.config.arithmetic
        kept = Cat(bounds.values()).all() if bounds else Value.cast(1)
        if not self.config.levels:
            return kept
        tests, record = self.level.tests, self._record()
        beside = Cat(bounds[name] for name in bounds if name.startswith("x"))
        m.d.sync += self.level.out.eq(record.around.any() & ~beside.all())
        error = converted(m, "error", Convert(REACH, format, 0), record.error)
        compare = compared(m, "compare_error", format, error, found.far_x)
        return Mux(tests, compare.less, kept)

    def _bounds(self, m: Module, found: data.View) -> dict[str, Value]:
        """High if a point within the bounds can be in front of the near plane, or inside the guard
        band at one of its sides.
        """
        if self.config.position != "chunk" or self.config.culling == "none":
            return {}
        pairs = {"front": (self.frame.near_plane, found.z_high)}
        for axis in "xy" if self.config.culling == "all" else "":
            far, high = found[f"far_{axis}"], found[f"{axis}_high"]
            if self.config.levels and axis == "x":
                far = Mux(self.level.tests, found.far_y, far)
            pairs[f"{axis}_low"] = (found[f"{axis}_low"], far)
            pairs[f"{axis}_high"] = (high ^ (1 << (len(high) - 1)), far)
        holds = {}
        for name, (less, more) in pairs.items():
            compare = compared(m, f"compare_{name}", self.config.arithmetic, less, more)
            holds[name] = compare.less if name == "front" else compare.less | compare.equal
        return holds
