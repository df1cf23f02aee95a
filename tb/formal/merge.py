"""Properties of the merge of two runs, as a component for a search in a bounded number of cycles.

The runs are any: their entries, their lengths and when these are written are free.
"""

from dataclasses import replace

from amaranth.hdl import Array, Assert, Assume, Cat, Const, Cover, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.sorting.merge import Merge
from splatcore.spec.config import TINY

SMALL = replace(TINY, sub_sorter_entries=4, merge_ways=2)

WAYS, ENTRIES = SMALL.merge_ways, SMALL.sub_sorter_entries

KEY_BITS = 3
"""Bits of a key that are free, the others are 0: enough for any order of all entries."""

PAUSE = 7
"""Cycles with room from an entry, or from the last writing, to the next entry, at most."""


class Merged(wiring.Component):
    """A merge, the runs it reads, and how many entries of each have been given.

    Asserted: each entry given is the next one of its run, so none is given twice or left out; no
    run has a smaller one, and no earlier run an equal one; it is busy as long as entries are left;
    with all entries written and room for them it gives them all. An entry that is read before it
    is written has any value.

    Assumed: runs are in order, and stay as they are until a reset; a merge begins when none is
    busy. Stop and reset come whenever they like.
    """

    def __init__(self):
        entry = {"keys": In(WAYS * ENTRIES * KEY_BITS), "indices": In(WAYS * ENTRIES * 2)}
        free = {"lengths": In(WAYS * 2), "runs": In(WAYS), "more": In(WAYS), "noise": In(11)}
        bits = dict.fromkeys(("begin", "stop", "room"), In(1))
        super().__init__(entry | free | bits)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = Merge(SMALL)
        keys, indices, lasts = self._runs(m)
        written, given = ([Signal(3, name=f"{n}{w}") for w in range(WAYS)] for n in ("wr", "given"))
        left = Signal(WAYS)  # a run has entries that have not been given
        m.d.comb += [
            part.begin.eq(self.begin),
            part.runs.eq(self.runs),
            part.stop.eq(self.stop),
            part.room.eq(self.room),
            Assume(~self.begin | (~part.busy & ~self.stop & self.runs.any())),
        ]
        way, o = part.o.slot.way, part.o
        ends = Signal(WAYS)
        for k in range(WAYS):
            mine = o.valid & (way == k)
            m.d.comb += part.written[k].eq(written[k])
            m.d.comb += ends[k].eq(mine & (given[k] == lasts[k]))
            m.d.sync += left[k].eq((left[k] | (self.begin & self.runs[k])) & ~ends[k] & ~self.stop)
            m.d.sync += given[k].eq(Mux(self.begin | self.stop, 0, given[k] + mine))
            m.d.sync += written[k].eq(written[k] + (self.more[k] & (written[k] <= lasts[k])))
            with m.If(self.stop | (part.busy & ((left & ~ends) == 0))):
                m.d.sync += written[k].eq(0)
            m.d.comb += Assert(~mine | (left[k] & (given[k] < written[k])))
            m.d.comb += Assert(~mine | (o.key == keys[k][given[k]]))
            m.d.comb += Assert(~mine | (o.slot.index == indices[k][given[k]]))
        head = [keys[k][given[k]] for k in range(WAYS)]
        m.d.comb += Assert(~o.valid | ~left.all() | (way == (head[1] < head[0])))
        m.d.comb += Assert(part.busy == left.any())
        self._answer(m, part, keys, indices, lasts, written)
        whole = Cat(~left[k] | (written[k] > lasts[k]) for k in range(WAYS)).all()
        waited = Signal(range(PAUSE + 2))
        m.d.sync += waited.eq(Mux(part.busy & whole & self.room & ~o.valid, waited + 1, 0))
        m.d.comb += Assert(waited <= PAUSE)
        self._reached(m, part, left, lasts, head, ends)
        return m

    def _runs(self, m: Module):
        """The keys and indices of each run, by rank, and the rank of its last entry."""
        everything = Cat(self.keys, self.indices, self.lengths)
        before, begun = Signal(len(everything)), Signal()
        m.d.sync += [before.eq(everything), begun.eq(1)]
        m.d.comb += Assume(~begun | (everything == before))
        keys, indices = [], []
        for k in range(WAYS):
            places = range(k * ENTRIES, (k + 1) * ENTRIES)
            keys.append(Array(self.keys.word_select(p, KEY_BITS) for p in places))
            indices.append(Array(self.indices.word_select(p, 2) for p in places))
            for rank in range(ENTRIES - 1):
                m.d.comb += Assume(keys[k][rank] <= keys[k][rank + 1])
        return keys, indices, [self.lengths.word_select(k, 2) for k in range(WAYS)]

    def _answer(self, m: Module, part: Merge, keys, indices, lasts, written):
        """The memory answers a cycle later."""
        rank = part.head.index
        for k in range(WAYS):
            with m.If(part.head.way == k):
                key = Cat(keys[k][rank], Const(0, SMALL.sort_key_bits - KEY_BITS))
                found = Cat(key, indices[k][rank], rank == lasts[k])
                there = rank < written[k]
                m.d.sync += part.found.eq(Mux(there, found, self.noise))

    def _reached(self, m: Module, part: Merge, left, lasts, head, ends):
        """A merge of two runs to the end, with equal heads on its way; then another one."""
        tie, whole = Signal(), Signal()
        full = Cat(last.all() for last in lasts).all()
        with m.If(self.begin):
            m.d.sync += tie.eq(0)
        with m.If(part.o.valid & left.all() & (head[0] == head[1])):
            m.d.sync += tie.eq(1)
        with m.If(self.stop):
            m.d.sync += whole.eq(0)
        with m.Elif(part.busy & ((left & ~ends) == 0)):
            m.d.sync += whole.eq(1)
        m.d.comb += Cover(part.o.valid & tie & full & ((left & ~ends) == 0))
        m.d.comb += Cover(part.o.valid & whole)
