"""Properties to prove of a sub-sorter, with their induction invariants.

The proof is of a small sub-sorter, with more phases than its few entries need. Few entries and
short keys lose nothing: the same loops build the trees at any size.
"""

from dataclasses import replace
from unittest.mock import patch

from amaranth.hdl import Assert, Assume, Cat, Cover, Module, Mux, Signal, Value

from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.spec.config import TINY
from tb.formal.axi_rules import Around
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

SIZES = (4, 8)
"""Entries of the sub-sorters that are proven; faults are planted into the smaller one."""

DIGITS = (2, 1, 2, 1, 2)

PHASES = [([(6, 2)], [(5, 1)]), ([], [(3, 2)]), ([(2, 1)], [(0, 2)])]
"""Digits (low bit, width) per phase, in its first and second cycle; one phase has no first ones."""


def small(entries: int = SIZES[0]) -> SubSorter:
    """Return a sub-sorter of `entries` entries, with keys of `DIGITS` and phases `PHASES`."""
    config = replace(TINY, sub_sorter_entries=entries, sort_digits=DIGITS)
    with patch("splatcore.hdl.sorting.subsort.phases", lambda config: PHASES):
        return SubSorter(config)


class Given(Around):
    """A sub-sorter, and the set of entries that went in and have not been chosen.

    Asserts:
    - the chosen entry is in the set, so none is chosen twice;
    - the set has no smaller key, and no equal key at a lower index;
    - the last one is marked as last, so all are chosen;
    - the output offers the chosen entry and keeps the offer until a drop, which empties all.

    Reset and drop may come in any cycle. (That the memory returns the key written is left to
    simulation.)
    """

    def __init__(self, part: SubSorter):
        super().__init__(part)
        self.count = part.entries
        self.remaining = Signal(self.count)

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        i, o, remaining = part.i, part.o, self.remaining
        m.d.comb += Assume((part.slot != self.count - 1) | i.payload.last)  # no batch is too large
        put, chosen = i.valid & i.ready, Signal(self.count)
        m.d.comb += chosen.eq(Mux(part.give, 1 << part.index, 0))
        entered = Mux(put, 1 << part.slot, 0)[: self.count]
        m.d.sync += remaining.eq(Mux(part.drop, 0, (remaining | entered) & ~chosen))
        offered, index, last = Signal(), Signal.like(part.index), Signal()
        keys = Value.cast(Cat(part.keys))
        m.d.sync += offered.eq(~part.drop & (part.give | (o.valid & ~o.ready)))
        with m.If(part.give):
            m.d.sync += [index.eq(part.index), last.eq((remaining & ~chosen) == 0)]
        m.d.comb += [
            Assert((chosen & ~remaining) == 0),
            Assert(o.valid == offered),
            Assert(~part.give | ~o.valid | o.ready),
            Assert(~o.valid | (o.payload.index == index)),
            Assert(~o.valid | (o.payload.last == last)),
            Assert(part.idle == ((remaining == 0) & ~o.valid)),
            Assert(~i.ready | (remaining == (1 << part.slot) - 1)),
            Cover(o.valid & o.ready & last & (index == 1)),
        ]
        for j, key in enumerate(part.keys):
            mine = keys.word_select(part.index, len(i.payload.key))
            larger = (mine < key) | ((mine == key) & (part.index <= j))
            m.d.comb += Assert(~part.give | ~remaining[j] | larger)
        self._why(m)
        return m

    def _why(self, m: Module):
        """Places of the remaining entries, in terms of the sub-sorter's registers."""
        part = self.inner
        held = [Mux(full, entries, 0) for full, entries in zip(part.full, part.sets, strict=True)]
        seen = part.full[0] | part.full[1] | part.full[2]
        everything = held[0] | held[1] | held[2]
        m.d.comb += Assert(self.remaining == Mux(seen, everything, part.sets[0]))
        m.d.comb += Assert(part.full[0] | ~seen | (part.sets[0] == 0))
        lows = [min(low for digits in cycles for low, _ in digits) for cycles in part.phases]
        for p, entries in enumerate(held):
            m.d.comb += Assert(~part.full[p] | entries.any())
            m.d.comb += Assert(~part.full[p] | (part.slot == 0))
            for other in held[:p]:
                m.d.comb += Assert((entries & other) == 0)
            # Entries of a phase agree in the digits before it, and are smaller there than entries
            # of earlier phases.
            for j, one in enumerate(part.keys):
                for k, two in enumerate(part.keys):
                    if p:
                        one_high, two_high = one[lows[p - 1] :], two[lows[p - 1] :]
                        alike = ~(entries[j] & entries[k]) | (one_high == two_high)
                        m.d.comb += Assert(alike)
                        for other in held[:p]:
                            m.d.comb += Assert(~(entries[j] & other[k]) | (one_high < two_high))
            self._half(m, p)
        last = held[-1]
        one = (last & (last - 1))[: self.count] == 0
        m.d.comb += Assert(~part.second | ~part.full[-1] | (part.single == one))
        m.d.comb += Assert(~part.second | seen)

    def _half(self, m: Module, p: int):
        """Check a phase's result after its first cycle."""
        part, entries = self.inner, self.inner.sets[p]
        digits = part.phases[p][0]
        first = [
            Cat(key[low : low + width] for low, width in reversed(digits)) for key in part.keys
        ]
        for k in range(self.count):
            smaller = Cat(entries[j] & (first[j] < first[k]) for j in range(self.count)).any()
            expected = entries[k] & ~(smaller if digits else 0)
            m.d.comb += Assert(~part.second | ~part.full[p] | (part.halves[p][k] == expected))


FAULTS = planted_in(
    SubSorter,
    elaborate={
        "a cluster is taken twice": ("~(leaving & takes", "~(0 & takes"),
        "the next cluster comes too early": ("takes & ~rest", "takes"),
        "the last entry is forgotten": ("rest, takes = ~self.single", "rest, takes = 0"),
        "not the last one": ("self.single & ~any_of", "self.single | any_of"),
        "an offer is overwritten": ("second & (~self.o.valid | self.o.ready)", "second"),
        "a drop forgets the sets only": ("*self.full, second,", "second,"),
    },
    _clusters={
        "a digit is not looked at": ("in digits:", "in digits[1:]:"),
        "the first cycle is not kept": ("s = self.halves[p]", "s = self.sets[p]"),
    },
)

PROOF = Proof(
    {
        f"{n} entries": Part(lambda n=n: Given(small(n)), cover=20, verify=n > SIZES[0])
        for n in SIZES
    },
    FAULTS,
)
