"""Properties to prove of credits, and of a part that pushes into a queue on credit."""

from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.stream import passes
from splatcore.hdl.memory.fetch import Fetch
from splatcore.spec.config import TINY
from tb.formal.axi_rules import Around, within
from tb.formal.proof import side_by_side
from tb.planted.fault import planted_in


class Given(wiring.Component):
    """A credit of `most` units, with each unit tracked: taken or not.

    Asserts: `count` is the number of units taken, so each unit comes back or is taken; `room` says
    whether one is left, `any` whether one is taken; and the credit's own assertions.

    Assumes: at most `step` units are taken per cycle, and none twice; a unit that comes back was
    taken before or in this cycle. The choice of units is free; one that comes back may be taken
    again in the same cycle.
    """

    def __init__(self, part: Credit):
        super().__init__({"takes": In(part.most), "back": In(part.most)})
        self.part = part

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = self.part
        takes, back, out = self.takes, self.back, Signal(part.most)
        m.d.comb += [
            part.comes.eq(sum(takes)),
            part.goes.eq(back.any()),
            Assume((sum(takes) <= part.step) & (sum(back) <= 1)),
            Assume((takes & out & ~back) == 0),
            Assume((back & ~out & ~takes) == 0),
        ]
        m.d.sync += out.eq(((out & ~back) | takes) & ~(back & ~out))
        m.d.comb += [
            Assert(part.count == sum(out)),
            Assert(part.room == ~out.all()),
            Assert(part.any == out.any()),
        ]
        full = Signal()
        m.d.sync += full.eq(full | out.all())
        m.d.comb += [Cover(full & ~out.any()), Cover(out.all() & takes.any() & back.any())]
        return m


class Fetching(Around):
    """A reader of ranges before a memory with any response time.

    Asserts:
    - the queue has room for every beat that arrives, though several are requested at once and none
      can be stalled;
    - room is reserved only for beats in flight or in the queue;
    - no deadlock: a burst waits for room only while beats of another are in flight or, after at
      most one cycle, offered; each beat taken makes room.

    Assumes: a beat comes only if it was requested; a range has at least one beat.
    """

    DEPTH, BURST, COUNT_BITS = 8, 4, 4  # beats in the queue, per burst; bits of a range's length

    def __init__(self):
        super().__init__(Fetch(TINY, self.DEPTH, self.COUNT_BITS, self.BURST))

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        i, reads, data, used = part.i, part.reads, part.data, part.used
        asked = Mux(passes(reads), reads.payload.length + 1, 0)
        coming = Signal(range(2 * self.DEPTH))  # beats requested that have not come
        m.d.sync += coming.eq(coming + asked - data.valid)
        m.d.comb += [
            Assume(~i.valid | (i.payload.count != 0)),
            Assume(~data.valid | (coming != 0)),
            Assert(used.count == coming + part.queue.level),
            Assert(~part.sized | reads.valid | used.any),
            # Why: a burst has 1 … `BURST` beats, as counted.
            Assert(i.ready | (part.rest.count != 0)),
            Assert(~part.sized | ((part.size != 0) & (part.size <= self.BURST))),
            Assert(~part.sized | (part.size == reads.payload.length + 1)),
        ]
        m.d.comb += Assert(part.queue.level >= part.o.valid)
        within(m, used.any & (coming == 0) & ~part.o.valid, 1)
        waits = part.sized & ~reads.valid
        m.d.comb += [Cover(waits & (coming == 0)), Cover(waits & (coming == self.DEPTH))]
        return m


def given(most: int, step: int = 1) -> Given:
    return Given(Credit(most, "units taken", step=step))


PARTS = {
    "one": lambda: given(1),
    "two": lambda: given(2),
    "five": lambda: given(5),  # not a power of two
    "several": lambda: given(8, step=4),
    "fetch": Fetching,
}

NEXT = "count.eq(then)"

OF_CREDIT = {
    "five": {
        "one too many": ("count != self.most", "count <= self.most"),
        "one too few": ("count != self.most", "count < self.most - 1"),
        "both at once is one more": (NEXT, "count.eq(count + (comes | -goes))"),
    },
    "two": {"empty too early": ("count.any()", "count[1:].any()")},
    "one": {"returned units are not counted": (NEXT, "count.eq(count + comes)")},
    "several": {"one of several is counted": (NEXT, "count.eq(count + comes.any() - goes)")},
}
OF_FETCH = {
    "fetch": {
        "a whole burst in one place": ("used.count + beats <= self.depth", "used.room"),
        "a burst counts for one": ("Mux(asked, beats, 0)", "asked"),
        "room before a beat leaves": ("goes.eq(passes(self.o))", "goes.eq(queue.i.valid)"),
        "no room for a whole burst": ("+ beats <= self.depth", "+ beats < self.burst"),
    },
}

PROOF = side_by_side(
    PARTS,
    {
        name: planted_in(kind, elaborate=texts)
        for kind, table in ((Credit, OF_CREDIT), (Fetch, OF_FETCH))
        for name, texts in table.items()
    },
    cover=20,  # cycles within which each part can be full, and empty again
)
