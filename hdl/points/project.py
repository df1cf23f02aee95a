"""Stage 1: projects points within the guard band to splats, with their attributes."""

from dataclasses import replace

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.convert import Convert, FromFixed, converted
from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import layout, same_fields, stream_of
from splatcore.hdl.lib.stream import Queue, passes
from splatcore.hdl.points.array import Array
from splatcore.hdl.points.codebook import codebook_line
from splatcore.hdl.points.colour import RAY, Colour
from splatcore.hdl.points.look_up import LookUp
from splatcore.hdl.points.slots import POINT, Slots
from splatcore.hdl.points.state import ModelState, frame_state
from splatcore.spec.compensation import ATTENUATIONS
from splatcore.spec.config import Config
from splatcore.spec.memory import ATTRIBUTE_BITS, OPACITY, step_format
from splatcore.spec.microprogram import projection
from splatcore.spec.number import Fixed
from splatcore.spec.point import WANTED, point_record, projecting_record, splat_record
from splatcore.spec.programs import COLOURS, SLOPES
from splatcore.spec.schedule import schedule

FACTOR = ("l00", "l10", "l11", "l20", "l21", "l22", *ATTENUATIONS)

SPARE = 2  # rows of the output queue beyond the array's capacity, for its latency


class Project(wiring.Component):
    """Turns points in the guard band into splats; requests their attributes meanwhile.

    A point waits for its attributes in a slot. Each part of a slot is read when the array needs it,
    so that no data travels through rounds that do not use it; its depth is read again for its
    splat. The array never stalls: a point enters if there will be room in the queue behind it.

    Colours are computed by a separate unit, and wait in their own queue for the rest of their
    splats; or they are computed in the array from values that are looked up (`Config.colours`).

    **Timing**: one Gaussian every `plan.interval` cycles (`DEFAULT`: 6 on nine PEs); `plan.length`
    + 5 cycles from its attributes to its splat.
    """

    def __init__(self, config: Config):
        self.config, self.beside = config, config.colours == "beside"
        self.program = projection(config)
        self.plan = schedule(config, self.program)
        self.slots = Slots(config)
        fields = set(self.program.fields)
        groups = {"point": POINT, "factor": FACTOR, "ray": RAY, "colour": (*COLOURS, *SLOPES)}
        self.groups = {
            part: names
            for part, all_names in groups.items()
            if (names := tuple(name for name in all_names if name in fields))
        }
        self.round = {part: self.plan.first_round(names) for part, names in self.groups.items()}
        late = {name: self.round[part] for part in self.groups for name in self.groups[part]}
        self.round["depth"] = (self.plan.length + 1) // self.plan.interval
        outputs = tuple(name for name in self.program.outputs if name != "z")
        self.array = Array(
            config,
            replace(self.program, outputs=outputs),
            late={name: number for name, number in late.items() if number},
            carried=self.slots.slot,
            stalls=False,
        )
        if self.beside:
            rounds = self.array.signature.members["rounds"].shape
            self.colour = Colour(config, rounds, self.plan.interval)
        else:
            self.colour = LookUp(config)
            if self.colour.interval > self.plan.interval:
                raise ValueError(
                    f"preset {config.name}: colours are looked up in {self.colour.interval} "
                    f"cycles, but a Gaussian begins every {self.plan.interval}"
                )
            # The codebook's answer is sampled in the last cycle before the round that needs it.
            self.ask = self.round["colour"] * self.plan.interval - 2 - self.colour.latency
            if self.ask < 0:
                raise ValueError(f"{config.name}: colours are needed before they can be looked up")
        self.splats_inside = self.array.round_count + SPARE
        """Maximum number of splats in the array and in the queue behind it."""
        ports = {
            "i": In(stream_of(point_record(config, "x y z"))),
            "chunks": In(stream_of(projecting_record())),  # taken with the chunk's last point
            "wanted": Out(stream_of(WANTED)),  # Gaussians whose attributes are to be read
            "attributes": In(stream.Signature(ATTRIBUTE_BITS)),  # the beats of these attributes
            "write": In(stream.Signature(codebook_line(config))),  # words of the codebook memory
            "frame": In(frame_state(config)),
            "model": In(ModelState),
            "o": Out(stream_of(splat_record(config))),  # in the order of `i`
            "entered": Out(1),  # the next round of the array begins with a Gaussian
            "starved": Out(1),  # it begins without one, because none is complete
            "blocked": Out(1),  # it begins without one, because splats are not taken
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.slots, m.submodules.colour = self.slots, self.colour
        m.submodules.array = self.array
        connect(m, flipped(self).i, self.slots.i)
        connect(m, flipped(self).chunks, self.slots.chunks)
        connect(m, flipped(self).wanted, self.slots.wanted)
        connect(m, flipped(self).attributes, self.slots.attributes)
        connect(m, flipped(self).write, self.colour.write)
        m.d.comb += [part.model.eq(self.model) for part in (self.slots, self.colour)]
        m.d.comb += same_fields(self.array.constants, self.frame.constants)
        room = self._output(m)
        self._enter(m, room)
        last_read = self._read(m)
        self._convert(m)
        last_read = max(last_read, self._colours(m) if self.beside else self._look_up(m))
        number, phase = divmod(last_read, self.plan.interval)
        m.d.comb += self.slots.release.eq(self.array.rounds[number].valid & self.array.phase[phase])
        return m

    def _output(self, m: Module) -> Value:
        """Queues of splats and of their colours; return whether they have room for one more."""
        depth, shape = self.splats_inside, layout(splat_record(self.config))
        found, names = self.array.o.payload.outputs, dict(shape.members)
        parts = {"splats": self.array.o.valid}
        sources = {n.removeprefix("colour_"): found[n] for n in found.shape().members}
        sources |= {n: self.slots.found.depth[n] for n in self.slots.found.depth.shape().members}
        if self.beside:
            parts["colours"] = self.colour.o.valid
        valid, queues = Const(1), []
        for name, comes in parts.items():
            own = {n: names[n] for n in names if (n in sources) == (name == "splats")}
            queue = Queue(data.StructLayout(own), depth, memory=True)
            m.submodules[name] = queue
            m.d.comb += queue.i.valid.eq(comes)
            never_waits(m, name, queue.i, f"one of the {name} from the array")
            for n in own:
                m.d.comb += queue.i.payload[n].eq(sources[n] if n in sources else self.colour.o[n])
                m.d.comb += self.o.payload[n].eq(queue.o.payload[n])
            valid &= queue.o.valid
            queues.append(queue)
        m.submodules.owed = owed = Credit(depth, "splats in the queues or in flight")
        m.d.comb += [
            self.o.valid.eq(valid),
            owed.comes.eq(self.entered),
            owed.goes.eq(passes(self.o)),
            *(queue.o.ready.eq(owed.goes) for queue in queues),
        ]
        return owed.room

    def _enter(self, m: Module, room: Value):
        """Decide in the last phase but one of a round whether a slot enters; in the last one it
        does.
        """
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

    def _read(self, m: Module) -> int:
        """Read each part of a slot just before the round that needs it, L one cycle earlier.

        Returns the last time at which a part is read.
        """
        rounds, phase, read = self.array.rounds, self.array.phase, self.slots.read
        last_read = 0
        for part in self.round:
            if part != "colour":
                before = self.round[part] - 1
                slot = rounds[before].carried if before >= 0 else self.slots.ready.payload
                early = 3 if self._behind_memory(part) else 2
                m.d.comb += [read[part].slot.eq(slot), read[part].enable.eq(phase[-early])]
                last_read = max(last_read, self.round[part] * self.plan.interval - early)
        return last_read

    def _behind_memory(self, part: str) -> bool:
        """Whether a part has a register between its memory and its converters.

        Only L has one, unless it is needed before it is known that the slot enters.
        """
        return part == "factor" and self.round[part] > 0

    def _field(self, name: str) -> Value:
        """The array's input for a field, early or late."""
        early = self.array.i.payload.fields
        return early[name] if name in early.shape().members else self.array.late[name]

    def _convert(self, m: Module):
        """Connect points and rays, which are floats; convert L and opacity to floats."""
        found, config = self.slots.found, self.config
        for part in ("point", "ray"):
            for name in self.groups.get(part, ()):
                m.d.comb += self._field(name).eq(found[part][name])
        record, factor = step_format(config, 0).attribute_record, Value.cast(found.factor)
        if self._behind_memory("factor"):
            factor = Signal(len(factor), reset_less=True)
            m.d.sync += factor.eq(found.factor)
        for name in self.groups["factor"]:
            field = "opacity" if name in ATTENUATIONS else name
            if name in ATTENUATIONS:  # counted in steps
                steps = Fixed(OPACITY.width, 0)
                convert = FromFixed(steps, config.arithmetic, 0)
            else:
                convert = Convert(record[field], config.arithmetic, 0)
            bits = factor[record.offset(field) :][: record[field].width]
            m.d.comb += self._field(name).eq(converted(m, f"convert_{name}", convert, bits))

    def _colours(self, m: Module) -> int:
        """Connect the inputs of `Colour`; return the last time at which a slot is read."""
        slots, colour = self.slots, self.colour
        m.d.comb += [colour.phase.eq(self.array.phase), colour.rounds.eq(self.array.rounds)]
        m.d.comb += [colour.beat[name].eq(slots.beat[name]) for name in slots.beat.shape().members]
        for part in ("index", "steps"):
            m.d.comb += slots.read[part].eq(getattr(colour, part))
            m.d.comb += getattr(colour, f"found_{part}").eq(slots.found[part])
        if "ray" in slots.parts:
            read, ready = slots.read.ray, slots.ready.payload
            m.d.comb += [read.slot.eq(ready), read.enable.eq(self.array.phase[-2])]
            m.d.comb += colour.ray.eq(slots.found.ray)
        return colour.last_read

    def _look_up(self, m: Module) -> int:
        """Look up colours and slopes; return the time at which the indices are read."""
        number, phase = divmod(self.ask, self.plan.interval)
        item, read = self.array.rounds[number], self.slots.read.index
        start = item.valid & self.array.phase[phase]
        m.d.comb += [read.slot.eq(item.carried), read.enable.eq(start)]
        m.d.sync += self.colour.start.eq(start)
        m.d.comb += self.colour.index.eq(self.slots.found.index)
        for name in self.groups["colour"]:
            m.d.comb += self._field(name).eq(self.colour.o[name])
        return self.ask
