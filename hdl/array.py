"""An array of processing elements that runs a microprogram on several items at once.

Which step runs where and when, and which register holds which value, is `spec.schedule`'s; this
file turns the plan into units, operand multiplexers, registers and the sequencer.
"""

from amaranth.hdl import Const, Module, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from hdl.choose import Clamp, Maximum
from hdl.multiply_add import MultiplyAdd
from hdl.unary import Reciprocal, ReciprocalRoot
from spec.config import Config
from spec.microprogram import Program
from spec.schedule import Place, latencies, pes, schedule


def codes(config: Config, names: tuple[str, ...]) -> data.StructLayout:
    """A float of `Config.arithmetic` for each name."""
    return data.StructLayout({name: config.arithmetic.width for name in names})


class Array(wiring.Component):
    """Runs a program of `spec.microprogram` on a stream of items.

    Members
        i: stream of the program's fields.
        constants: the program's constants; may change while no item is inside.
        o: stream of its outputs, in the same order.

    **Timing**: an item every `plan.interval` cycles, taken in the last phase of a round; its
    outputs come `plan.length` + 1 cycles later. While `o` is not taken everything stands still.
    """

    def __init__(self, config: Config, program: Program):
        self.config, self.program = config, program
        self.plan = schedule(config, program)
        super().__init__(
            {
                "i": In(stream.Signature(codes(config, program.fields))),
                "constants": In(codes(config, program.constants)),
                "o": Out(stream.Signature(codes(config, program.outputs))),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        self.enable = Signal()
        self.phase = Signal(range(self.plan.interval))
        self._sequence(m)
        self._units(m)
        self._registers(m)
        self._operands(m)
        m.d.comb += [
            self.o.payload[name].eq(self._source(name, self.plan.length))
            for name in self.program.outputs
        ]
        return m

    def _sequence(self, m: Module):
        """Phases, and the items' fields on their way: one place on at the end of each round."""
        last = self.plan.interval - 1
        rounds = self.plan.length // self.plan.interval + 1
        valid = Signal(rounds)
        layout = codes(self.config, self.program.fields)
        self.places = [
            Signal(layout, name=f"fields_{place}", reset_less=True) for place in range(rounds)
        ]
        done = self.o.valid & self.o.ready
        m.d.comb += [
            self.o.valid.eq(valid[-1] & (self.phase == self.plan.length % self.plan.interval)),
            self.enable.eq(~self.o.valid | done),
            self.i.ready.eq(self.enable & (self.phase == last)),
        ]
        with m.If(self.enable):
            m.d.sync += self.phase.eq(self.phase + 1)
            with m.If(self.phase == last):
                m.d.sync += [self.phase.eq(0), valid.eq(valid << 1 | self.i.valid)]
                m.d.sync += self.places[0].eq(self.i.payload)
                m.d.sync += [b.eq(a) for a, b in zip(self.places, self.places[1:], strict=False)]

    def _units(self, m: Module):
        """The PEs, and one unit of each other kind that the program needs."""
        config = self.config
        delay = latencies(config)
        self.units = {
            ("pe", number): MultiplyAdd(config.arithmetic, delay["pe"])
            for number in range(pes(config, self.program))
        }
        others = {
            "reciprocal": lambda: Reciprocal(config.arithmetic, delay["reciprocal"]),
            "root": lambda: ReciprocalRoot(config.arithmetic, delay["root"]),
            "clamp": lambda: Clamp(config.arithmetic),
            "maximum": lambda: Maximum(config.arithmetic),
        }
        used = {step.unit for step in self.program.steps}
        self.units |= {(kind, 0): make() for kind, make in others.items() if kind in used}
        for (kind, number), unit in self.units.items():
            m.submodules[f"{kind}{number}" if kind == "pe" else kind] = unit
            m.d.comb += unit.enable.eq(self.enable)

    def _registers(self, m: Module):
        """The banks: every wait takes its value over in one phase of each round."""
        self.banks = {}
        for wait in self.plan.waits:
            key = (wait.bank, wait.register)
            if key not in self.banks:
                name = f"{wait.bank[0]}{wait.bank[1]}_wait{wait.register}"
                self.banks[key] = Signal(self.config.arithmetic.width, name=name, reset_less=True)
        for key, register in self.banks.items():
            with m.If(self.enable), m.Switch(self.phase):
                for wait in self.plan.waits:
                    if (wait.bank, wait.register) == key:
                        with m.Case(wait.begin % self.plan.interval):
                            m.d.sync += register.eq(self._source(wait.value, wait.begin))

    def _operands(self, m: Module):
        """The units' operands: one source for each phase."""
        for key, unit in self.units.items():
            with m.Switch(self.phase):
                for place in self.plan.places:
                    if (place.step.unit, place.number) == key:
                        with m.Case(place.time % self.plan.interval):
                            self._drive(m, unit, place)

    def _drive(self, m: Module, unit: wiring.Component, place: Place):
        """A step's operands; an absent factor is 1, an absent summand a zero."""
        step, format = place.step, self.config.arithmetic
        a = self._source(step.a, place.time)
        if step.negate:
            a = a ^ (1 << (format.width - 1))
        m.d.comb += unit.a.eq(a)
        if step.unit == "pe":
            one = Const(int(format.encode(1.0)), format.width)
            # −0 + −0 = −0 and −0 + x = x; a format without −0 reads it as 0
            nothing = Const(1 << (format.width - 1), format.width)
            b = self._source(step.b, place.time) if step.b else one
            c = self._source(step.c, place.time) if step.c else nothing
            m.d.comb += [unit.b.eq(b), unit.c.eq(c)]
        elif step.b:
            m.d.comb += unit.b.eq(self._source(step.b, place.time))

    def _source(self, name: str, time: int) -> Value:
        """Where a value is to be read at a time of its item."""
        if name in self.program.constants:
            return self.constants[name]
        if name in self.program.fields:
            return self.places[time // self.plan.interval][name]
        place = next(place for place in self.plan.places if place.step.name == name)
        if time == place.time + dict(self.plan.latencies)[place.step.unit]:
            return self.units[place.step.unit, place.number].o
        wait = next(w for w in self.plan.waits if w.value == name and w.begin < time <= w.end)
        return self.banks[wait.bank, wait.register]
