"""Properties of the merge of two runs, to check by a search within a bounded number of cycles.

The runs are free: their entries, their lengths and the cycles in which entries are written.
"""

from dataclasses import replace

from amaranth.hdl import Array, Assert, Assume, Cat, Const, Cover, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.sorting.merge import Merge
from splatcore.spec.config import TINY
from tb.formal.axi_rules import constant
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

SMALL = replace(TINY, sub_sorter_entries=4, merge_ways=2)

WAYS, ENTRIES = SMALL.merge_ways, SMALL.sub_sorter_entries

KEY_BITS = 3
"""Free bits per key, the others are 0: enough for any order of all entries."""

PAUSE = 7
"""Cycles with room from an entry, or from the last write, to the next entry: maximum."""


class Merged(wiring.Component):
    """A merge, the runs it reads, and the number of entries taken from each.

    Asserts:
    - each output entry is the next one of its run, so none is repeated or left out;
    - no other run has a smaller head, and no earlier run an equal one;
    - the merge is busy as long as entries are left; with all entries written and room for them, it
      outputs them all.

    Assumes: runs are sorted and constant until a reset; a merge begins only while it is not busy;
    an entry read before it is written has any value. Stop and reset may come in any cycle.
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
        left = Signal(WAYS)  # a run has entries that have not left
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
        """Return each run's keys and indices by rank, and the rank of its last entry."""
        constant(m, Cat(self.keys, self.indices, self.lengths))
        keys, indices = [], []
        for k in range(WAYS):
            places = range(k * ENTRIES, (k + 1) * ENTRIES)
            keys.append(Array(self.keys.word_select(p, KEY_BITS) for p in places))
            indices.append(Array(self.indices.word_select(p, 2) for p in places))
            for rank in range(ENTRIES - 1):
                m.d.comb += Assume(keys[k][rank] <= keys[k][rank + 1])
        return keys, indices, [self.lengths.word_select(k, 2) for k in range(WAYS)]

    def _answer(self, m: Module, part: Merge, keys, indices, lasts, written):
        """Answer each read one cycle later, with noise if the entry is not yet written."""
        rank = part.head.slot.index
        for k in range(WAYS):
            with m.If(part.head.slot.way == k):
                key = Cat(keys[k][rank], Const(0, SMALL.sort_key_bits - KEY_BITS))
                found = Cat(key, indices[k][rank], rank == lasts[k])
                there = rank < written[k]
                m.d.sync += part.found.eq(Mux(there, found, self.noise))

    def _reached(self, m: Module, part: Merge, left, lasts, head, ends):
        """Cover a complete merge of two full runs with equal heads, and one after another."""
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


DEPTH = 14  # cycles; takes half a minute, two more cycles take more than twice as long
COVER_DEPTH = 20  # cycles within which two full runs can be merged, or a merge can follow another

FAULTS = planted_in(
    Merge,
    _compare={
        "not stable": ("< Cat(first.key, first.gone)", "<= Cat(first.key, first.gone)"),
        "a run at its end stays": ("leaf.gone.eq(~self.live[way])", "leaf.gone.eq(0)"),
    },
    _fetch={
        "read before it is written": ("pointer != self.written[way]", "1"),
        "an entry is overwritten": ("~fetching & ~self.waits & left", "~fetching & left"),
        "nothing is read": ("asked.eq(first)", "asked.eq(0)"),
        "a place is read early": ("self.waits & left", "self.waits"),
    },
    _advance={
        "the one behind is forgotten": ("Mux(waits, behind, self.found)", "self.found"),
        "a found entry is lost": ("waits | arrives", "waits"),
    },
    elaborate={
        "given without room": ("second & self.room", "second"),
        "given without a head": ("(~self.live | self.present).all()", "1"),
        "a stop leaves heads": ("(self.live, self.present, ", "(self.live, "),
    },
)

PROOF = Proof(
    {
        "short": Part(Merged, search=DEPTH - 2, cover=COVER_DEPTH),
        "long": Part(Merged, search=DEPTH, verify=True),
    },
    FAULTS,
    {"": Part(Merged, search=DEPTH)},
)
