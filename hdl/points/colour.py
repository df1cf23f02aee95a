"""Colours of Gaussians in small integers, computed outside the array (`spec.colour`)."""

from collections.abc import Iterator
from itertools import product

from amaranth.hdl import Cat, Const, Module, Mux, Shape, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.convert import ToFixed
from splatcore.hdl.points.array import Array
from splatcore.hdl.points.codebook import INDEX_BITS, Codebook, codebook_line
from splatcore.hdl.points.state import ModelState
from splatcore.hdl.points.terms import SHIFT_BITS, Terms, lanes_of
from splatcore.spec.colour import (
    BASIS,
    CHANNELS,
    DEGREES,
    GAIN,
    LAYOUT_BITS,
    LAYOUTS,
    LOW,
    POLYNOMIAL,
    STEP_BITS,
    TERMS,
    Term,
    unscaled_colour_format,
)
from splatcore.spec.config import Config
from splatcore.spec.microprogram import basis
from splatcore.spec.programs import BASIS_CONSTANTS
from splatcore.spec.schedule import basis_machine, colour_terms, colour_turns

RAY = ("ray_x", "ray_y", "ray_z")

RAYS = data.StructLayout(dict.fromkeys(RAY, BASIS.width))

STEPS = data.StructLayout({"harmonics": LAYOUT_BITS, "step": data.ArrayLayout(STEP_BITS, DEGREES)})
"""Values of a Gaussian from its chunk's header."""

BEATS = 2
"""Beats of harmonics that a slot has room for."""


class Colour(wiring.Component):
    """Computes the colours of Gaussians from rays and attributes, with a fixed latency.

    The polynomials are computed by an array that runs in step with the projection's, whose `phase`
    and `rounds` show where each slot is. All other parts of a slot are read when they are needed.

    Parameters:
        rounds: layout of the projection's `rounds`, whose `carried` is the slot
        interval: cycles per round

    **Timing**: one Gaussian per round of at least `spec.schedule.colour_cycles` cycles; its colours
    appear in time `latency` (`DEFAULT`: 42), counted in cycles since its first round began. All
    parts are read by time `last_read`.
    """

    def __init__(self, config: Config, rounds: data.ArrayLayout, interval: int):
        self.config, self.interval = config, interval
        self.codebook = Codebook(config)
        self.terms = colour_turns(config)
        self.turns = colour_terms(config)
        if interval < max(self.turns, self.codebook.interval):
            raise ValueError(f"preset {config.name}: colours take longer than {interval} cycles")
        if self.codebook.words < BEATS * config.projection_slots:
            raise ValueError(f"preset {config.name}: codebook is too small for the slots' beats")
        # Time of the base and the first term, when its polynomials and all of G are available.
        self.begin = self.codebook.latency + 1
        if self.terms:
            self.basis = Array(basis_machine(config), basis(config), stalls=False)
            first, *_ = TERMS[0].polynomials
            self.begin = self.basis.plan.read_time(first)
            if self.begin <= self.codebook.latency:
                raise ValueError(f"preset {config.name}: polynomials are made before G is read")
        self.latency = self.begin + self.turns - 1 + Terms.latency
        self.last_read = self.begin - 1 + max((first for _, _, first in self._later), default=0)
        slot = rounds.elem_shape["carried"].shape
        reading = data.StructLayout({"slot": slot, "enable": 1})
        colour = unscaled_colour_format(config).width
        line = codebook_line(config)
        ports = {
            "write": In(stream.Signature(line)),  # words of the codebook memory
            # {valid, address, word}, a beat of harmonics; the address is the slot's number times
            # `BEATS` plus the number of the beat
            "beat": In(data.StructLayout({"valid": 1} | line.members)),
            "model": In(ModelState),
            "phase": In(interval),  # of the projection's array
            "rounds": In(rounds),  # of the projection's array
            "index": Out(reading),  # {slot, enable}, parts of a slot to be read
            "steps": Out(reading),  # {slot, enable}, parts of a slot to be read
            # these parts one cycle later; held until the next reading
            "found_index": In(INDEX_BITS),
            "found_steps": In(STEPS),  # these parts one cycle later; held until the next reading
            # {valid, red, green, blue}, codes of `unscaled_colour_format`, for one cycle
            "o": Out(data.StructLayout({"valid": 1} | dict.fromkeys(CHANNELS, colour))),
        }
        if self.terms:
            # codes of `BASIS` of the Gaussian that enters at the end of this cycle, if there is one
            ports["ray"] = In(RAYS)
        super().__init__(ports)

    @property
    def _later(self) -> list[tuple[int, int, int]]:
        """Further beats of layouts: (layout, beat, the first turn of a term in the beat)."""
        found = []
        for number, layout in enumerate(LAYOUTS):
            for beat, record in enumerate(layout.records[1:], 1):
                turns = [t for t, k, _, _ in self._places() if f"red_{k}" in dict(record.fields)]
                found += [(number, beat, turns[0] - 1)] if turns else []
        return found

    def _places(self) -> Iterator[tuple[int, int, Term, int]]:
        """Yield bit of `turn`, index, term and first lane of each term."""
        for turn, terms in enumerate(self.terms, 1):
            for k, lane in zip(terms, lanes_of(self.config), strict=False):
                yield turn, k, TERMS[k], lane.start

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.codebook = codebook = self.codebook
        connect(m, flipped(self).write, codebook.write)
        m.d.comb += [codebook.beat.eq(self.beat), codebook.model.eq(self.model)]
        m.d.comb += codebook.index.eq(self.found_index)
        # Bit 0 is set when the first beat of harmonics is read, bit 1 when the base and the first
        # term are due, bit 2 for the second term, and so on.
        self.turn = Signal(1 + self.turns + Terms.latency)
        m.d.sync += self.turn.eq(Cat(self._at(self.begin - 2), self.turn))
        self._read(m)
        m.submodules.terms = terms = self.sum = Terms(self.config, codebook.colour[0].shape().width)
        m.d.comb += [terms.first.eq(self.turn[1]), terms.half.eq(~self.model.codebooks)]
        m.d.comb += terms.base.eq(self._base(m))
        self._shift(m)
        if self.terms:
            self._multiplicands(m)
            self._polynomials(m)
        m.d.comb += self.o.valid.eq(self.turn[self.turns + Terms.latency])
        m.d.comb += [self.o[c].eq(code) for c, code in zip(CHANNELS, terms.o, strict=True)]
        return m

    def _base(self, m: Module) -> Value:
        """The codebook's colour, in the cycle after its own if it does not stay until then."""
        colour = self.codebook.colour
        if self.interval > self.codebook.interval:
            return colour
        later = Signal(colour.shape(), name="base", reset_less=True)
        m.d.sync += later.eq(colour)
        return later

    def _at(self, time: int) -> Value:
        """High if a Gaussian is at that time."""
        number, phase = divmod(time, self.interval)
        return self.rounds[number].valid & self.phase[phase]

    def _slot(self, time: int) -> Value:
        """The slot of the Gaussian in the round of that time."""
        return self.rounds[time // self.interval].carried

    def _read(self, m: Module):
        """Read parts of the slot and beats of harmonics, each just before it is needed."""
        start = self.begin - self.codebook.latency
        for read, time in ((self.index, start - 1), (self.steps, self.begin - 1)):
            m.d.comb += [read.slot.eq(self._slot(time)), read.enable.eq(self._at(time))]
        m.d.comb += self.codebook.start.eq(self._at(start))
        slot, beat, enable = self._slot(self.begin - 1), Const(0, 1), self.turn[0]
        for number, later_beat, first in self._later:
            chosen = self.turn[first] & (self.found_steps.harmonics == number)
            slot = Mux(chosen, self._slot(self.begin - 1 + first), slot)
            beat |= Mux(chosen, later_beat, 0)
            enable |= chosen
        read = self.codebook.read
        m.d.comb += [read.address.eq(Cat(beat[:1], slot)), read.enable.eq(enable)]

    def _shift(self, m: Module):
        """The shift and factor of the base and of each term."""
        steps, in_steps = self.found_steps.step, ~self.model.codebooks
        m.d.comb += self.sum.base_shift.eq(
            GAIN - self.model.exponent[0] + Mux(in_steps, steps[0] >> 1, 0)
        )
        m.d.comb += self.sum.base_three.eq(in_steps & steps[0][0])
        if not self.terms:
            return
        word, third = self.codebook.word, Signal(2)
        with m.If(self.turn[1]):
            m.d.sync += third.eq(word[4:6])
        exponent, step, own = self.model.exponent[1], steps[1], word[0:2]
        for degree, shift in ((2, word[2:4]), (3, third)):
            turns = {turn for turn, _, term, _ in self._places() if term.degree == degree}
            chosen = Cat(self.turn[k] for k in sorted(turns)).any() & in_steps
            exponent = Mux(chosen, self.model.exponent[degree], exponent)
            step = Mux(chosen, steps[degree], step)
            own = Mux(chosen, shift, own)
        finer = Mux(self.turn[1], -1, -1 - LOW)
        change = Mux(in_steps, (step >> 1) + own, finer)
        m.d.comb += self.sum.shift.eq((GAIN - exponent + change)[:SHIFT_BITS])
        m.d.comb += self.sum.three.eq(in_steps & step[0])

    def _multiplicands(self, m: Module):
        """Codes of a term from the beat of harmonics, or a part of G."""
        word, harmonics = self.codebook.word, self.found_steps.harmonics
        for c, channel in enumerate(CHANNELS):
            sources: list[list[Value]] = [[] for _ in range(self.sum.lanes)]
            for (number, layout), (turn, k, term, first) in product(
                enumerate(LAYOUTS), self._places()
            ):
                if term.degree > layout.degree:
                    continue
                chosen = self.turn[turn] & (harmonics == number) & ~self.model.codebooks
                field, width = f"{channel}_{k}", layout.format(term.degree).width
                record = next(r for r in layout.records if field in dict(r.fields))
                for lane in range(len(term.polynomials)):
                    code = word[record.offset(field) + lane * width :][:width]
                    value = Cat(Const(layout.halves, 1), code).as_signed()
                    sources[first + lane].append(Mux(chosen, value, 0))
            for lane, axis in enumerate((1, 2, 0)):  # y, z, x
                g = self.codebook.g[len(RAY) * c + axis]
                for turn, part in ((1, g[:LOW]), (2, g[LOW:].as_signed())):
                    chosen = self.turn[turn] & self.model.codebooks & self.model.sh
                    sources[lane].append(Mux(chosen, part, 0))
            for lane, found in enumerate(sources):
                value = Const(0)
                for source in found:
                    value |= source
                m.d.comb += self.sum.multiplicands[c][lane].eq(value)

    def _polynomials(self, m: Module):
        """The array that computes the polynomials; each turn, a term's polynomials as integers."""
        m.submodules.basis = array = self.basis
        constants = array.constants
        m.d.comb += [
            constants[name].eq(int(BASIS.encode(BASIS_CONSTANTS[name])))
            for name in constants.shape().members
        ]
        m.d.comb += [array.i.payload.fields.eq(self.ray), array.i.valid.eq(1)]
        outputs = array.o.payload.outputs
        scales = range(min(min(t.doubled) for t in TERMS), max(max(t.doubled) for t in TERMS) + 1)
        for lane in range(self.sum.lanes):
            # If products are multiplier blocks, there is more time for rounding than for shifting.
            registers = 1 if self.config.logic == "gates" else {"shift": 1, "round": 0}
            convert = ToFixed(BASIS, POLYNOMIAL, registers, scales)
            m.submodules[f"polynomial_{lane}"] = convert
            value, scale = Const(0), Signal(Shape.cast(scales), name=f"scale_{lane}")
            for turn, _, term, first in self._places():
                if 0 <= (own := lane - first) < len(term.polynomials):
                    value |= Mux(self.turn[turn], outputs[term.polynomials[own]], 0)
                    with m.If(self.turn[turn - 1]):  # decoded in the cycle before
                        m.d.sync += scale.eq(term.doubled[own])
            # Both parts of G are multiplied by the polynomials of the first term.
            m.d.comb += convert.enable.eq(~(self.model.codebooks & self.turn[2]))
            m.d.comb += [convert.i.eq(value), convert.scale.eq(scale)]
            m.d.comb += self.sum.polynomials[lane].eq(convert.o)
