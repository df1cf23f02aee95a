"""Stage 1: projects points within the guard band to splats, with their attributes."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.convert import Convert, FromFixed
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.points.array import Array, codes
from splatcore.hdl.points.codebook import Codebook
from splatcore.hdl.points.slots import FACTOR_BITS, POINT, RAY, Slots
from splatcore.spec.config import Config
from splatcore.spec.memory import OPACITY, model_format
from splatcore.spec.microprogram import projection
from splatcore.spec.number import Fixed
from splatcore.spec.point import splat_record
from splatcore.spec.programs import COLOURS, SLOPES
from splatcore.spec.schedule import schedule

FACTOR = ("l00", "l10", "l11", "l20", "l21", "l22", "attenuation")

SPARE = 2  # rows of the output queue beyond what the array can hold: what passing through it takes


class Project(wiring.Component):
    """Points in the guard band in, splats out; attributes are asked for on the way.

    A point waits for its attributes in a slot. Each part of a slot is read when the array wants
    it, so that nothing travels through rounds that do not use it. The array never stalls: a point
    enters if its splat will find room in the queue behind it.

    Members
        i, chunks, wanted, attributes: those of `hdl.points.slots`.
        write, sh, colour_exponent, sh_exponent: those of `hdl.points.codebook`.
        constants: registers of the frame.
        o: stream of `splat_record`, in the order of `i`.
        entered, starved, blocked: a round of the array begins next with a Gaussian, with none
            because none is complete, with none because splats are not taken.

    **Timing**: a Gaussian every `plan.interval` cycles (`DEFAULT`: 11 on six PEs, 6 on twelve);
    `plan.length` + 5 cycles from its attributes to its splat.
    """

    def __init__(self, config: Config):
        self.config = config
        self.program = projection(config)
        self.plan = schedule(config, self.program)
        self.slots, self.look_up = Slots(config), Codebook(config)
        fields = set(self.program.fields)
        groups = {"point": POINT, "factor": FACTOR, "ray": RAY, "colour": (*COLOURS, *SLOPES)}
        self.groups = {
            part: names
            for part, all_names in groups.items()
            if (names := tuple(name for name in all_names if name in fields))
        }
        self.round = {part: self.plan.first_round(names) for part, names in self.groups.items()}
        late = {name: self.round[part] for part in self.groups for name in self.groups[part]}
        self.array = Array(
            config,
            self.program,
            late={name: number for name, number in late.items() if number},
            carried=self.slots.slot,
            stalls=False,
        )
        # The codebook's answer is sampled in the last cycle before the round that wants it.
        answer = self.round["colour"] * self.plan.interval - 1
        self.ask = answer - self.look_up.latency - 1
        if self.ask < 0:
            raise ValueError(f"{config.name}: colours are wanted before they can be looked up")
        outside = ("write", "sh", "colour_exponent", "sh_exponent")
        self.tables = [name for name in outside if name in self.look_up.signature.members]
        self.splats_inside = self.array.round_count + SPARE
        """Splats in the array and in the queue behind it, at most."""
        inner = self.slots.signature.members
        ports = {name: inner[name] for name in ("i", "chunks", "wanted", "attributes")}
        ports |= {name: self.look_up.signature.members[name] for name in self.tables}
        ports |= {
            "constants": In(codes(config, self.program.constants)),
            "o": Out(stream.Signature(layout(splat_record(config)))),
            "entered": Out(1),
            "starved": Out(1),
            "blocked": Out(1),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.slots, m.submodules.codebook = self.slots, self.look_up
        m.submodules.array = self.array
        connect(m, flipped(self).i, self.slots.i)
        connect(m, flipped(self).chunks, self.slots.chunks)
        connect(m, flipped(self).wanted, self.slots.wanted)
        connect(m, flipped(self).attributes, self.slots.attributes)
        if "write" in self.tables:
            connect(m, flipped(self).write, self.look_up.write)
        for name in self.tables:
            if name != "write":
                m.d.comb += getattr(self.look_up, name).eq(getattr(self, name))
        m.d.comb += self.array.constants.eq(self.constants)
        room = self._output(m)
        self._enter(m, room)
        self._read(m)
        self._convert(m)
        self._look_up(m)
        return m

    def _output(self, m: Module) -> Value:
        """The queue of splats; returns a bit that says that it will have room for one more."""
        depth = self.splats_inside
        m.submodules.splats = queue = Queue(layout(splat_record(self.config)), depth, memory=True)
        found, splat = self.array.o.payload.outputs, queue.i.payload
        for name in splat.shape().members:
            source = name if name in self.program.outputs else f"colour_{name}"
            m.d.comb += splat[name].eq(found[source])
        m.d.comb += queue.i.valid.eq(self.array.o.valid)
        connect(m, flipped(self).o, queue.o)
        owed = Signal(range(depth + 1))  # splats in the queue or on their way to it
        gone = self.o.valid & self.o.ready
        with m.If(self.entered != gone):
            m.d.sync += owed.eq(Mux(gone, owed - 1, owed + 1))
        return owed != depth

    def _enter(self, m: Module, room: Value):
        """The last phase but one of a round decides whether a slot enters; in the last it does."""
        complete, free = Signal(), Signal()
        with m.If(self.array.phase[-2]):
            m.d.sync += [complete.eq(self.slots.ready.valid), free.eq(room)]
        enters, last = complete & free, self.array.phase[-1]
        m.d.comb += [
            self.array.i.valid.eq(enters),
            self.array.i.payload.carried.eq(self.slots.ready.payload),
            self.entered.eq(enters & last),
            self.starved.eq(~complete & last),
            self.blocked.eq(complete & ~free & last),
            self.slots.ready.ready.eq(self.entered),
        ]

    def _read(self, m: Module):
        """Each part of a slot is read just before the round that wants it."""
        rounds, phase, read = self.array.rounds, self.array.phase, self.slots.read
        last_read = 0
        for part in self.groups:
            if part != "colour":
                before = self.round[part] - 1
                slot = rounds[before].carried if before >= 0 else self.slots.ready.payload
                m.d.comb += [read[part].slot.eq(slot), read[part].enable.eq(phase[-2])]
                last_read = max(last_read, before)
        number, time = divmod(self.ask, self.plan.interval)
        start = rounds[number].valid & phase[time]
        m.d.comb += [read.index.slot.eq(rounds[number].carried), read.index.enable.eq(start)]
        m.d.sync += self.look_up.start.eq(start)
        oldest = rounds[max(last_read, number)]
        m.d.comb += self.slots.release.eq(oldest.valid & phase[-1])

    def _field(self, name: str) -> Value:
        """The array's input for a field, early or late."""
        early = self.array.i.payload.fields
        return early[name] if name in early.shape().members else self.array.late[name]

    def _convert(self, m: Module):
        """Points and rays are floats already; L and opacity become so."""
        found, config = self.slots.found, self.config
        for part in ("point", "ray"):
            for name in self.groups.get(part, ()):
                m.d.comb += self._field(name).eq(found[part][name])
        record = model_format(config, config.sh_degree).attribute_record
        for name in FACTOR:
            field = "opacity" if name == "attenuation" else name
            if name == "attenuation":  # counted in steps
                steps = Fixed(OPACITY.width, 0)
                convert = FromFixed(steps, config.arithmetic, 0)
            else:
                convert = Convert(record[field], config.arithmetic, 0)
            m.submodules[f"convert_{name}"] = convert
            bits = Value.cast(found.factor)[record.offset(field) :][: record[field].width]
            m.d.comb += [convert.i.eq(bits), convert.enable.eq(1), self._field(name).eq(convert.o)]

    def _look_up(self, m: Module):
        """Indices to colours and slopes. Models without harmonics have theirs at other offsets."""
        bits, index = Value.cast(self.slots.found.index), self.look_up.index
        records = [
            model_format(self.config, degree).attribute_record
            for degree in range(self.config.sh_degree + 1)
        ]
        for name in index.shape().members:
            fields = [
                bits[record.offset(name) - FACTOR_BITS :][: record[name].width]
                for record in records
                if name in dict(record.fields)
            ]
            if len(fields) == 2:
                m.d.comb += index[name].eq(Mux(self.sh, fields[1], fields[0]))
            else:
                m.d.comb += index[name].eq(Cat(fields))
        for name in self.groups["colour"]:
            m.d.comb += self._field(name).eq(self.look_up.o[name])
