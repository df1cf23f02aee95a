"""Properties of a sorter's releases around a cascade, as a component to prove, and why they hold.

In the cascade's place stands what is known of it: batches leave in their order, whole, when they
like (`tb.formal.cascade`).
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
from tb.formal.cascade import SMALL, Seen

LEVEL_BITS = 4  # of counts of batches; no part holds as many


class Batches(wiring.Component):
    """Batches that go in and come out.

    takes, gives: entries pass now; ends: it is a batch's last one.
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
        first = ~self.begins & (self.inside == 1)  # it is still coming
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
    """A sorter around any cascade."""
    part = "splatcore.hdl.sorting.sorter"
    with patch(f"{part}.Queue", Seen), patch(f"{part}.Cascade", Batches):
        return Sorter(SMALL)


class Released(wiring.Component):
    """A sorter, and one batch, any.

    Asserted: it leaves with its own target; from the cycle after a release of its half on, if it
    had begun before, nothing of it leaves, and its entries wait for nobody; without one all of them
    are offered. An entry goes to the cascade when it is taken. The sorter is idle if no batch is
    inside, and only then.

    Nothing is assumed of releases; reset comes whenever it likes.
    """

    def __init__(self, part: Sorter):
        self.part, to = part, part.i.payload.to.shape()
        bits = ("valid", "last", "ready", "pick", "takes", "gives", "ends")
        super().__init__(dict.fromkeys(bits, In(1)) | {"to": In(to), "release": In(HALVES)})
        self.followed, self.dropped = Signal(), Signal()
        self.target, self.ahead = Signal(to), Signal(LEVEL_BITS)  # batches ahead, dropped or not

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.sorter = part = self.part
        inner, followed, o = part.part, self.followed, part.o
        m.d.comb += [
            part.i.valid.eq(self.valid),
            part.i.payload.entry.last.eq(self.last),
            part.i.payload.to.eq(self.to),
            part.release.eq(self.release),
            o.ready.eq(self.ready),
            inner.takes.eq(self.takes),
            inner.gives.eq(self.gives),
            inner.ends.eq(self.ends),
        ]
        goes, mine = passes(inner.o) & inner.o.payload.last, Signal()
        picked = passes(part.i) & inner.begins & self.pick & ~followed
        m.d.comb += mine.eq(inner.o.valid & followed & (self.ahead == 0))
        with m.If(picked):
            m.d.sync += [followed.eq(1), self.dropped.eq(0), self.target.eq(self.to)]
            m.d.sync += self.ahead.eq(inner.inside - goes)
        with m.Elif(followed):
            m.d.sync += [followed.eq(~(mine & goes)), self.ahead.eq(self.ahead - (goes & ~mine))]
            released = self.release.bit_select(self.target.half, 1)
            m.d.sync += self.dropped.eq(self.dropped | released)
        target = Value.cast(self.target)
        m.d.comb += [
            Assert(~mine | (o.valid == ~self.dropped)),
            Assert(~mine | (inner.o.ready == (self.ready | self.dropped))),
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
        """Targets are those of the batches inside; the first ones of a half are those dropped."""
        part, targets = self.part, self.part.targets
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
