"""Properties to prove of the choice of levels, for all records and all models."""

from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, connect, flipped

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import passes
from splatcore.hdl.points.level import Level
from splatcore.spec.levels import LEVEL
from splatcore.spec.point import NUMBER_BITS
from tb.formal.axi_rules import constant
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in


class Walk(wiring.Component):
    """The choice of levels, with the counter of headers of `hdl.points.chunk` around it.

    Asserts, for any records:
    - no item waits except for what takes it: a walk ends after as many items as the model has;
    - each header is passed on or dropped, so that each chunk's number comes once;
    - exactly the records that contradict their place are reported.

    Asserts, for records that are not reported:
    - a header is passed on if its chunk is in no subtree of a group drawn or out of view before,
      and is of the finest level or of a group in view that is coarse enough; else it is dropped;
    - after the last header the next frame begins as the first one did;
    - the reader turns only to spare headers that would be dropped, and not while it is turning.

    Assumes: the model is the same during a frame, and has fewer than 2^24 chunks; the reader has
    asked for the header that is awaited, and for none behind the last one; a header comes a
    cycle or more behind its record.
    """

    def __init__(self, valid: bool):
        self.valid, part = valid, Level()
        members = {
            name: part.signature.members[name]
            for name in ("i", "levels", "last", "enough", "out", "turn")
        }
        super().__init__(members | {"ready": In(1)})
        self.part = part

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = self.part
        connect(m, flipped(self).i, part.i)
        number, record = Signal(NUMBER_BITS), data.View(layout(LEVEL), Value.cast(self.i.payload))
        constant(m, self.levels)
        constant(m, self.last)
        header = Signal()  # the item is a header
        coarse, done = record.error.any(), passes(self.i) & (header | ~self.levels)
        is_record = self.i.valid & self.levels & ~header
        m.d.comb += [
            part.number.eq(number),
            part.levels.eq(self.levels),
            part.last.eq(self.last),
            part.enough.eq(self.enough),
            part.out.eq(self.out),
            part.o.ready.eq(self.ready),
            Assume((number <= self.last) & ~self.last.all()),
            Assert(self.i.ready | (part.o.valid & ~self.ready) | ~self.i.valid),
            Assert(~part.o.valid | (part.o.payload.as_value() == self.i.payload.as_value())),
            Assert(done == ((passes(part.o) & ~part.tests) | part.dropped)),
            Assert(~(part.o.valid & part.dropped)),
            Assert(~part.o.valid | (part.tests == is_record)),
        ]
        with m.If(passes(self.i) & self.levels):
            m.d.sync += header.eq(~header)
        turning, turn, target = Signal(), Signal(NUMBER_BITS), Signal(NUMBER_BITS)
        m.d.comb += [
            part.turn.eq(self.turn),
            Assume((self.turn > number) & (self.turn <= self.last + 1)),
            Assume(~part.begins | ~self.i.valid),
            Assert(part.over == (turning & (number + 1 == turn))),
            Assert((part.turning == turning) & (~turning | (part.until == turn))),
            Assert(~turning | ((number < turn) & (turn < target) & part.skips)),
            Assert(~turning | ((target == part.end + 1) & (part.end <= self.last))),
            Assert(~part.jump | ~turning & (self.turn < part.target)),
        ]
        with m.If(part.jump):
            m.d.sync += [turning.eq(1), turn.eq(self.turn), target.eq(part.target)]
        with m.If(done):
            m.d.sync += number.eq(Mux(number == self.last, 0, number + 1))
            with m.If(part.over):
                m.d.sync += [number.eq(Mux(target == self.last + 1, 0, target)), turning.eq(0)]
        before = Signal()  # the record before is of the same group
        wrong = Mux(coarse, record.jump <= number + 1, record.jump != number + 1)
        wrong |= (record.jump > self.last + 1) | (~coarse & (before | ~record.last))
        reported = Signal()
        with m.If(passes(self.i) & is_record):
            m.d.sync += before.eq(coarse & ~record.last)
        with m.If(done & part.over):
            m.d.sync += before.eq(0)
        m.d.sync += reported.eq(passes(self.i) & is_record & wrong)
        m.d.comb += Assert(part.fault == reported)
        m.d.comb += Assert((part.of_header == header) & (part.again == before))
        m.d.comb += Assert(self.levels | ~(header | before | part.skips))
        if self.valid:
            m.d.comb += Assume(~is_record | ~wrong)
            self._chosen(m, header, number, before)
        return m

    def _chosen(self, m: Module, header: Signal, number: Signal, before: Signal):
        """Check the choice against the definition: by the ends of the subtrees left out."""
        part, record = self.part, data.View(layout(LEVEL), Value.cast(self.i.payload))
        coarse, until = record.error.any(), Signal(NUMBER_BITS + 1)
        left_out = number < until
        chosen = Signal()  # the last chunk is drawn, and its group if it is of one
        unseen = Signal()  # the last chunk's group is out of view
        hidden = Mux(before, unseen, self.out)
        decision = Mux(before, chosen, self.enough) & ~hidden
        m.d.comb += [
            Assert(~(self.i.valid & header) | (part.o.valid == chosen)),
            Assert((part.drawn == chosen) & (self.levels | (until == 0))),
            Assert(~before | (part.ends == (chosen | unseen))),
            Assert(~(chosen & unseen)),
            Assert(part.skips == left_out),
            Assert(~left_out | ((until == part.end + 1) & (part.end <= self.last))),
            Cover(part.dropped & (number == self.last) & (number == 4)),
            Cover(passes(part.o) & header & left_out & record.last),
        ]
        with m.If(passes(self.i) & self.levels & ~header):
            m.d.sync += chosen.eq(~left_out & (~coarse | decision))
            m.d.sync += unseen.eq(~left_out & coarse & hidden)
            with m.If(~left_out & coarse & (decision | hidden) & record.last):
                m.d.sync += until.eq(record.jump)
        ends = (number == self.last) | (part.over & (until == self.last + 1))
        with m.If(passes(self.i) & header & ends):
            m.d.sync += until.eq(0)


FAULTS = planted_in(
    Level,
    elaborate={
        "chunks of a subtree are drawn": ("~self.skips & (~coarse", "(~coarse"),
        "chunks of a group decide alone": ("self.again, self.drawn,", "self.again, self.enough,"),
        "a jump from the first of a group": ("ends & record.last", "ends"),
        "a group out of view is drawn": ("self.enough & ~self.out", "self.enough"),
        "a group out of view is refined": ("self.enough | self.out", "self.enough"),
        "a group out of view is refined behind its first": (
            "self.again, self.ends,",
            "self.again, self.drawn,",
        ),
        "a jump to the chunk before": ("record.jump - 1", "record.jump - 2"),
        "a finer chunk at the own place": ("end <= self.number", "end < self.number"),
        "a jump beyond the end": ("wrong |= end > self.last", ""),
        "a dropped header waits": ("self.o.ready | ~on", "self.o.ready"),
        "a record comes as a header": ("self.levels & ~self.of_header", "0"),
        "a group goes on behind a turn": ("m.If(self.over)", "m.If(0)"),
        "headers are dropped after a turn": (
            "(self.number == self.end) | self.over",
            "self.number == self.end",
        ),
    },
    _jump={
        "a turn after a wrong record": ("~self.of_header & ~wrong", "~self.of_header"),
        "a turn to the last one left out": ("self.end + 1", "self.end"),
        "a turn back": ("] < self.end", "] <= self.end"),
        "a turn one header late": ("self.number + 1 ==", "self.number =="),
    },
)

REPORTED = (
    "a finer chunk at the own place",
    "a jump beyond the end",
    "a turn after a wrong record",
)

PROOF = Proof(
    {"any": Part(lambda: Walk(False)), "valid": Part(lambda: Walk(True), cover=14)},
    FAULTS,
    {"": Part(lambda: Walk(True), search=8)} | dict.fromkeys(REPORTED, Part(lambda: Walk(False))),
)
