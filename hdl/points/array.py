"""An array of processing elements that runs a microprogram on several items at once.

`spec.schedule` decides when and on which unit each step runs, and which register holds each value;
this file turns that plan into units, operand multiplexers, registers and a sequencer.
"""

from collections.abc import Mapping
from itertools import pairwise

from amaranth.hdl import Cat, Const, Module, ShapeLike, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.arithmetic.add import MultiplyAdd
from splatcore.hdl.arithmetic.minmax import Clamp, Maximum
from splatcore.hdl.arithmetic.unary import Reciprocal, Rsqrt
from splatcore.hdl.points.compensation import Fade, Log, LogSum, Minor, Product
from splatcore.hdl.points.state import codes
from splatcore.spec.config import Config
from splatcore.spec.microprogram import COMPENSATION_UNITS, Program
from splatcore.spec.schedule import Place, latencies, schedule, units_of


class Array(wiring.Component):
    """Runs a program of `spec.microprogram` on a stream of items.

    A field that is first read in a later round can enter then (`late`), which saves registers: the
    `carried` data identifies the item in each round.

    Parameters:
        program: the steps, fields, constants and outputs
        late: field → the round at whose beginning it enters
        carried: shape of the data that accompanies each item unchanged
        held: `i.payload` is stable while an item is inside and fields are read from there; so only
            one item is inside at a time, and a round begins when one comes
        stalls: whether `o.ready` may be low; an array that never stalls needs no enables

    **Timing**: one item every `plan.interval` cycles, taken in the last phase of a round; its
    outputs come `plan.length` + 1 cycles later, outputs in `plan.early` sooner. While `o` is not
    taken, or no item is inside, all units hold.
    """

    def __init__(
        self,
        config: Config,
        program: Program,
        *,
        late: Mapping[str, int] | None = None,
        carried: ShapeLike | None = None,
        held: bool = False,
        stalls: bool = True,
    ):
        self.config, self.program, self.held, self.stalls = config, program, held, stalls
        self.plan = schedule(config, program)
        self.entry = {name: 0 for name in program.fields} | dict(late or {})
        early = tuple(name for name in program.fields if not self.entry[name])
        extra = {} if carried is None else {"carried": carried}
        self.inside = data.StructLayout({"valid": 1, **extra})
        self.round_count = self.plan.length // self.plan.interval + 1
        ports = {
            # {fields, carried}: the program's fields that are not late, and the data
            "i": In(stream.Signature(data.StructLayout({"fields": codes(config, early), **extra}))),
            # each is sampled in the last phase of the round before its own
            "late": In(codes(config, tuple(late or ()))),
            # the program's constants; may change while no item is inside
            "constants": In(codes(config, program.constants)),
            # {outputs, carried}, in the same order
            "o": Out(stream.Signature(
                data.StructLayout({"outputs": codes(config, program.outputs), **extra})
            )),
            "phase": Out(self.plan.interval, init=1),  # one-hot, the present cycle of the round
            # {valid, carried} of the item in each round
            "rounds": Out(data.ArrayLayout(self.inside, self.round_count)),
        }  # fmt: skip
        if not late:
            del ports["late"]
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.config.arithmetic
        self.one = Const(int(format.encode(1.0)), format.width)
        # −0 + −0 = −0 and −0 + x = x; a format without −0 reads it as 0
        self.nothing = Const(1 << (format.width - 1), format.width)
        self.known = {name: self.constants[name] for name in self.program.constants}
        self.enable = Signal() if self.stalls else Const(1)
        self.active = Cat(inside.valid for inside in self.rounds).any()
        self.last = self.phase[-1]
        self.decoded: dict[tuple[int, ...], Signal] = {}
        self._sequence(m)
        self._fields(m)
        self._units(m)
        self._registers(m)
        self._operands(m)
        m.d.comb += [
            self.o.payload.outputs[name].eq(self._source(name, self.plan.read_time(name)))
            for name in self.program.outputs
        ]
        return m

    def _sequence(self, m: Module):
        """Phases, and the items in flight, which advance by one round at the end of each round."""
        inside = [Signal(self.inside, name=f"round_{k}") for k in range(self.round_count)]
        m.d.comb += [
            self.rounds.eq(Cat(inside)),
            self.o.valid.eq(inside[-1].valid & self.phase[self.plan.length % self.plan.interval]),
            self.i.ready.eq(self.enable & self.last),
        ]
        if self.stalls:
            waits = self.last & ~self.active & ~self.i.valid if self.held else 0
            m.d.comb += self.enable.eq((~self.o.valid | self.o.ready) & ~waits)
        with m.If(self.enable):
            m.d.sync += self.phase.eq(self.phase.rotate_left(1))
            with m.If(self.last):
                m.d.sync += [inside[0].valid.eq(self.i.valid)]
                m.d.sync += [b.eq(a) for a, b in pairwise(inside)]
        if self.held:
            with m.If(self.o.valid & self.o.ready):
                m.d.sync += inside[-1].valid.eq(0)
        if "carried" in self.inside.members:
            m.d.comb += self.o.payload.carried.eq(inside[-1].carried)
            with m.If(self.enable & self.last):
                m.d.sync += inside[0].carried.eq(self.i.payload.carried)

    def _fields(self, m: Module):
        """Registers of the fields, each from the round in which it enters to its last use."""
        self.field_at: dict[tuple[str, int], Value] = {}
        last_use = {name: self.plan.length for name in self.program.outputs}
        for slot in self.plan.places:
            for name in slot.step.operands:
                last_use[name] = max(last_use.get(name, 0), slot.time)
        for name, entry in self.entry.items():
            source = self.late[name] if entry else self.i.payload.fields[name]
            for number in range(entry, last_use[name] // self.plan.interval + 1):
                if not self.held:
                    before = source
                    source = Signal(before.shape(), name=f"{name}_{number}", reset_less=True)
                    valid = self.rounds[number - 1].valid if number else self.i.valid
                    with m.If(self.enable & self.last & valid):
                        m.d.sync += source.eq(before)
                self.field_at[name, number] = source

    def _units(self, m: Module):
        """The PEs, and the units of each other kind that the program needs."""
        config, counts = self.config, units_of(self.config, self.program)
        delay = latencies(config)
        kinds = {
            "pe": lambda: MultiplyAdd(config.arithmetic, delay["pe"]),
            "reciprocal": lambda: Reciprocal(config.arithmetic, delay["reciprocal"]),
            "rsqrt": lambda: Rsqrt(config.arithmetic, delay["rsqrt"]),
            "clamp": lambda: Clamp(config.arithmetic),
            "maximum": lambda: Maximum(config.arithmetic),
            "product": lambda: Product(config, delay["product"]),
            "minor": lambda: Minor(config),
            "log": lambda: Log(config),
            "log_sum": lambda: LogSum(config),
            "fade": lambda: Fade(config),
        }
        used = {"pe"} | {step.unit for step in self.program.steps}
        self.units = {
            (kind, k): make()
            for kind, make in kinds.items() if kind in used
            for k in range(counts[kind])
        }  # fmt: skip
        for (kind, number), unit in self.units.items():
            m.submodules[f"{kind}{number}" if kind == "pe" or number else kind] = unit
            enable = self.enable
            if kind in COMPENSATION_UNITS:  # idle for models without compensation
                enable = enable & self.constants.antialiased.any()
            m.d.comb += unit.enable.eq(enable & self.active)

    def _during(self, m: Module, numbers: tuple[int, ...]) -> Value:
        """High in these phases.

        Decoded in the previous cycle if operands have no register before the multipliers.
        """
        if self.units["pe", 0].multiply.registers["operand"]:
            return Cat(self.phase[number] for number in numbers).any()
        if numbers not in self.decoded:
            signal = Signal(init=0 in numbers, name="_".join(map(str, ("during", *numbers))))
            with m.If(self.enable):
                m.d.sync += signal.eq(Cat(self.phase[number - 1] for number in numbers).any())
            self.decoded[numbers] = signal
        return self.decoded[numbers]

    def _select(self, m: Module, sources: Mapping[int, Value]) -> Value:
        """The source of the present phase; 0 or any source in phases that have none."""
        phases: dict[int, list[int]] = {}  # by identity of the source
        for number, source in sources.items():
            phases.setdefault(id(source), []).append(number)
        if len(phases) == 1:
            return next(iter(sources.values()))
        value = Const(0)
        for numbers in phases.values():
            source = sources[numbers[0]]
            value |= source & self._during(m, tuple(sorted(numbers))).replicate(len(source))
        return value

    def _registers(self, m: Module):
        """The banks: every register is loaded in fixed phases of each round."""
        takes: dict[tuple, dict[int, object]] = {}
        for wait in self.plan.waits:
            phase = wait.begin % self.plan.interval
            takes.setdefault((wait.bank, wait.register), {})[phase] = wait
        self.banks = {}
        for key in takes:
            (unit, number), register = key
            name = f"{unit}{number}_wait{register}"
            self.banks[key] = Signal(len(self.units[unit, number].o), name=name, reset_less=True)
        for key, waits in takes.items():
            sources = {p: self._source(wait.value, wait.begin) for p, wait in waits.items()}
            value, loads = self._select(m, sources), self._during(m, tuple(sorted(waits)))
            with m.If(self.enable & self.active & loads):
                m.d.sync += self.banks[key].eq(value)

    def _operands(self, m: Module):
        """The units' operands: one source per phase."""
        operands: dict[tuple, dict[str, dict[int, Value]]] = {}
        for slot in self.plan.places:
            key = (slot.step.unit, slot.number)
            for port, source in self._sources(slot).items():
                ports = operands.setdefault(key, {}).setdefault(port, {})
                ports[slot.time % self.plan.interval] = source
        for key, ports in operands.items():
            for port, sources in ports.items():
                m.d.comb += getattr(self.units[key], port).eq(self._select(m, sources))

    def _sources(self, slot: Place) -> dict[str, Value]:
        """A step's operands by port; a missing factor is 1, a missing summand a zero."""
        step = slot.step
        a = self._source(step.a, slot.time)
        sources = {"a": a ^ (1 << (len(a) - 1)) if step.negate else a}
        if step.b:
            sources["b"] = self._source(step.b, slot.time)
        if step.c:
            sources["c"] = self._source(step.c, slot.time)
        if step.unit == "pe":
            sources.setdefault("b", self.one)
            sources.setdefault("c", self.nothing)
        return sources

    def _source(self, name: str, time: int) -> Value:
        """A value at a time of its item: a constant, a field, a unit's output or a register."""
        if name in self.program.constants:
            return self.known[name]
        if name in self.program.fields:
            return self.field_at[name, time // self.plan.interval]
        slot = next(slot for slot in self.plan.places if slot.step.name == name)
        if time == slot.time + dict(self.plan.latencies)[slot.step.unit]:
            return self.units[slot.step.unit, slot.number].o
        wait = next(w for w in self.plan.waits if w.value == name and w.begin < time <= w.end)
        return self.banks[wait.bank, wait.register]
