"""Properties to prove of releases of a sorter with a cascade, with their induction invariants.

A model with the proven properties of the cascade (`tb.formal.cascade`) replaces it: whole batches
leave in order, after any time.
"""

from unittest.mock import patch

from amaranth.hdl import Array, Assert, Cover, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import passes
from splatcore.hdl.sorting.sorter import HALVES, Sorter
from splatcore.spec.config import Config
from splatcore.spec.sort import batch_record, ranked_record
from tb.formal.axi_rules import Around
from tb.formal.cascade import SMALL, Seen
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

LEVEL_BITS = 4  # of batch counters; no part holds that many


class Batches(wiring.Component):
    """Model of a cascade: whole batches go in and come out in order.

    takes, gives: an entry may enter, leave in this cycle
    ends: the leaving entry is the last of its batch
    """

    def __init__(self, config: Config):
        i, o = (
            stream.Signature(layout(record(config))) for record in (batch_record, ranked_record)
        )
        bits = dict.fromkeys(("takes", "gives", "ends"), In(1))
        super().__init__({"i": In(i), "o": Out(o)} | bits)
        self.begins = Signal(init=1)  # the next entry to come begins a batch
        self.inside = Signal(LEVEL_BITS)  # batches that have begun and not left

    def elaborate(self, platform) -> Module:
        m = Module()
        i, o = self.i, self.o
        comes, goes = passes(i) & self.begins, passes(o) & o.payload.last
        first = ~self.begins & (self.inside == 1)  # the oldest batch is still coming in
        waiting, last = Signal(), Signal()
        m.d.comb += [
            i.ready.eq(self.takes),
            o.valid.eq(waiting | (self.gives & (self.inside != 0))),
            o.payload.last.eq(Mux(waiting, last, self.ends & ~first)),
        ]
        m.d.comb += Assert(~waiting | ((self.inside != 0) & ~(last & first)))
        m.d.sync += [waiting.eq(o.valid & ~o.ready), last.eq(o.payload.last)]
        m.d.sync += self.inside.eq(self.inside + comes - goes)
        with m.If(passes(i)):
            m.d.sync += self.begins.eq(i.payload.last)
        return m


def sorter() -> Sorter:
    """Return a sorter around the model of a cascade."""
    part = "splatcore.hdl.sorting.sorter"
    with patch(f"{part}.Queue", Seen), patch(f"{part}.Cascade", Batches):
        return Sorter(SMALL)


class Released(Around):
    """A sorter, and one batch, freely chosen.

    Asserts:
    - the batch leaves with its own target;
    - if its half is released after the batch began, from the next cycle on no entry of it is
      offered or stalls; without a release all its entries are offered;
    - an entry goes to the cascade in the cycle in which it is accepted;
    - the sorter is idle exactly if no batch is inside.

    Assumes nothing of releases; reset may come in any cycle.
    """

    def __init__(self, part: Sorter):
        super().__init__(part, **dict.fromkeys(("pick", "takes", "gives", "ends"), In(1)))
        to = part.i.payload.to.shape()
        self.followed, self.dropped = Signal(), Signal()
        self.target, self.ahead = Signal(to), Signal(LEVEL_BITS)  # batches ahead, dropped or not

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        inner, followed, o = part.part, self.followed, part.o
        m.d.comb += [
            inner.takes.eq(self.takes),
            inner.gives.eq(self.gives),
            inner.ends.eq(self.ends),
        ]
        goes, mine = passes(inner.o) & inner.o.payload.last, Signal()
        picked = passes(part.i) & inner.begins & self.pick & ~followed
        m.d.comb += mine.eq(inner.o.valid & followed & (self.ahead == 0))
        with m.If(picked):
            m.d.sync += [followed.eq(1), self.dropped.eq(0), self.target.eq(part.i.payload.to)]
            m.d.sync += self.ahead.eq(inner.inside - goes)
        with m.Elif(followed):
            m.d.sync += [followed.eq(~(mine & goes)), self.ahead.eq(self.ahead - (goes & ~mine))]
            released = part.release.bit_select(self.target.half, 1)
            m.d.sync += self.dropped.eq(self.dropped | released)
        target = Value.cast(self.target)
        m.d.comb += [
            Assert(~mine | (o.valid == ~self.dropped)),
            Assert(~mine | (inner.o.ready == (part.o.ready | self.dropped))),
            Assert(~mine | (Value.cast(o.payload.to) == target)),
            Assert(~mine | (o.payload.entry.last == inner.o.payload.last)),
            Assert(~o.valid | inner.o.valid),
            Assert(passes(part.i) == passes(inner.i)),
            Assert(part.idle == (inner.inside == 0)),
            Assert(~part.idle | ~self.takes | part.i.ready),
            Cover(mine & goes & ~self.dropped & (part.drops[0] != 0) & self.target.half),
            Cover(mine & goes & self.dropped & (part.drops[1] == 2)),
        ]
        self._why(m)
        return m

    def _why(self, m: Module):
        """Each batch inside has its target in the queue; a half's oldest batches are dropped."""
        part, targets = self.inner, self.inner.targets
        m.d.comb += Assert(targets.level == part.part.inside)
        for half in range(HALVES):
            counted = [item.half == half for item in targets.items]
            inside = sum((k < targets.level) & one for k, one in enumerate(counted))
            before = sum((k < self.ahead) & one for k, one in enumerate(counted))
            m.d.comb += Assert(part.inside[half].count == inside)
            m.d.comb += Assert(part.drops[half] <= part.inside[half].count)
            mine = self.followed & (self.target.half == half)
            m.d.comb += Assert(~mine | (self.dropped == (before < part.drops[half])))
        found = Array(map(Value.cast, targets.items))[self.ahead]
        m.d.comb += Assert(~self.followed | (self.ahead < targets.level))
        m.d.comb += Assert(~self.followed | (found == Value.cast(self.target)))
        m.d.comb += Assert(part.begins == part.part.begins)
        m.d.comb += Assert(part.begins | (part.part.inside != 0))


FAULTS = planted_in(
    Sorter,
    _batches={
        "nothing is dropped": ("drops.eq(inside.count - inside.goes)", "drops.eq(0)"),
        "all is dropped from then on": ("drops.eq(drops - 1)", "drops.eq(drops)"),
        "a batch is dropped too few": ("inside.count - inside.goes)\n", "inside.count - 1)\n"),
        "the batch that begins is dropped": (
            "drops.eq(inside.count - inside.goes)",
            "drops.eq(inside.count + inside.comes)",
        ),
        "the other half's is dropped": ("dropped[1], dropped[0]", "*dropped"),
        "a batch goes to the first's": ("eq(i.payload.entry.last)", "eq(0)"),
        "a dropped one waits": ("o.ready | stale", "o.ready"),
        "a dropped one is offered": ("part.o.valid & ~stale", "part.o.valid"),
    },
)

DEPTH = 10  # cycles within which batches can be dropped, and every fault shows

PROOF = Proof(
    {"releases": Part(lambda: Released(sorter()), cover=DEPTH)},
    FAULTS,
    {"": Part(lambda: Released(sorter()), search=DEPTH)},
)
