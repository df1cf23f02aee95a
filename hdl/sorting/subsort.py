"""A sub-sorter: sorts a batch of entries by their keys without comparing any two of them.

Keys are examined digit by digit, most significant first. For every value of a digit an OR-tree over
all entries finds whether a candidate has it; a candidate stays if no other has a smaller one.
"""

from collections.abc import Callable, Sequence

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import stream_of
from splatcore.spec.config import Config
from splatcore.spec.sort import batch_record, phases, ranked_record


def tree(operator: Callable, values: Sequence[Value]) -> Value:
    """Combine values in a balanced tree."""
    values = list(values)
    while len(values) > 1:
        pairs = [operator(*values[k : k + 2]) for k in range(0, len(values) - 1, 2)]
        values = pairs + values[len(pairs) * 2 :]
    return values[0]


def any_of(values: Sequence[Value]) -> Value:
    """High if one of the values is."""
    return tree(lambda a, b: a | b, values)


def smallest(m: Module, candidates: Value, digits: list[Value], name: str) -> Value:
    """The candidates with the smallest digit."""
    lines = 1 << len(digits[0])
    is_digit = [Signal(len(digits), name=f"{name}_is{line}") for line in range(lines)]
    smaller = Signal(lines, name=f"{name}_smaller")
    present = Signal(lines - 1, name=f"{name}_present")
    for line in range(lines):
        m.d.comb += is_digit[line].eq(Cat(digit == line for digit in digits))
        if line < lines - 1:  # nothing is larger than the last one
            m.d.comb += present[line].eq((candidates & is_digit[line]).any())
        if line:
            m.d.comb += smaller[line].eq(present[:line].any())
    stays = Signal(len(digits), name=f"{name}_stays")
    excluded = [is_digit[k] & smaller[k].replicate(len(digits)) for k in range(1, lines)]
    m.d.comb += stays.eq(candidates & ~any_of(excluded))
    return stays


def lowest(m: Module, candidates: Value) -> Value:
    """The lowest set bit, `x & (~x + 1)` in prefix form."""
    below, step = candidates, 1
    while step < len(candidates):
        wider = Signal(len(candidates), name=f"below{step}")
        m.d.comb += wider.eq(below | below << step)
        below, step = wider, step * 2
    return candidates & ~(below << 1)[: len(candidates)]


def lowest_index(m: Module, candidates: Value) -> Value:
    """Index of the lowest set bit; the width is a power of two."""
    level, width = [(bit, Const(0, 0)) for bit in candidates], 0
    while len(level) > 1:
        pairs = []
        for k in range(0, len(level), 2):
            (low, low_index), (high, high_index) = level[k : k + 2]
            present = Signal(name=f"present{width}_{k}")
            index = Signal(width + 1, name=f"at{width}_{k}")
            lower = [Mux(low, *bits) for bits in zip(low_index, high_index, strict=True)]
            m.d.comb += [present.eq(low | high), index.eq(Cat(*lower, ~low))]
            pairs.append((present, index))
        level, width = pairs, width + 1
    return level[0][1]


class SubSorter(wiring.Component):
    """Sorts batches of up to `Config.sub_sorter_entries` entries, stably.

    Entries pass phases (`spec.sort.phases`) in rounds of two cycles. A phase has a set of entries
    and finds the entries with the smallest value of its digits, a *cluster*; the next phase takes
    the cluster and examines its own digits. The last phase outputs its entries one by one. A phase
    takes a new cluster in the round in which it passes on its last entry, so a cluster is found
    while the previous one is used, and every round outputs an entry.

    **Timing**: one entry in per cycle, one out every two cycles whatever the keys, the first one
    2·phases + 1 cycles after the last one came. No multiplier; a memory of all keys.
    """

    def __init__(self, config: Config):
        self.config, self.phases = config, phases(config)
        self.entries = config.sub_sorter_entries
        ports = {
            # a batch is taken when the previous one has left, and output when its last entry is in
            "i": In(stream_of(batch_record(config))),
            "o": Out(stream_of(ranked_record(config))),
            "drop": In(1),  # all entries are dropped; none leaves in the next cycle
            "idle": Out(1),  # no entry is inside
        }
        super().__init__(ports)
        width = config.sort_key_bits
        self.keys = [Signal(width, name=f"key{k}", reset_less=True) for k in range(self.entries)]
        self.sets = [Signal(self.entries, name=f"set{p}") for p in range(len(self.phases))]
        self.full = [Signal(name=f"full{p}") for p in range(len(self.phases))]
        self.halves = [
            Signal(self.entries, name=f"half{p}", reset_less=True) for p in range(len(self.phases))
        ]
        self.single, self.second = Signal(), Signal()
        self.slot, self.give = Signal(range(self.entries)), Signal()
        self.index = Signal.like(self.slot)

    def elaborate(self, platform) -> Module:
        m = Module()
        busy = any_of(self.full)
        # A round is one cycle with `second` low, then cycles with it high until there is room.
        second, ends = self.second, Signal()
        m.d.comb += [ends.eq(second & (~self.o.valid | self.o.ready)), self.i.ready.eq(~busy)]
        m.d.comb += self.idle.eq(~busy & ~self.o.valid & (self.slot == 0))
        m.d.sync += second.eq(Mux(second, ~ends, busy))
        clusters = self._clusters(m)
        chosen = Signal(self.entries)
        m.d.comb += chosen.eq(lowest(m, clusters[-1]))

        rest, takes = ~self.single, self.full[-1]
        for p in reversed(range(len(self.phases))):
            entering, leaving = self.sets[p], clusters[p]
            before = self.full[p - 1] if p else Const(0, 1)
            if p == len(self.phases) - 1:
                leaving = chosen
            else:
                rest = Signal(name=f"rest{p}")
                m.d.comb += rest.eq((entering & ~leaving).any())
            free = Signal(name=f"free{p}")  # for a cluster of the phase before
            m.d.comb += free.eq(~self.full[p] | (takes & ~rest))
            stays = entering & ~(leaving & takes.replicate(self.entries))
            with m.If(ends):
                m.d.sync += entering.eq(Mux(free, clusters[p - 1], stays) if p else stays)
                m.d.sync += self.full[p].eq(Mux(free, before, 1))
            takes = before & free
        self._load(m)
        self._give(m, clusters[-1], ends, self.single & ~any_of([Const(0, 1), *self.full[:-1]]))
        with m.If(self.drop):
            m.d.sync += [signal.eq(0) for signal in (*self.full, second, self.slot, self.o.valid)]
            m.d.sync += self.sets[0].eq(0)
        return m

    def _clusters(self, m: Module) -> list[Value]:
        """The cluster that each phase finds in the second cycle.

        A set does not change during a round, so registers between the cycles may always load.
        """
        found = []
        for p, cycles in enumerate(self.phases):
            candidates = self.sets[p]
            for cycle, digits in enumerate(cycles):
                if cycle:
                    m.d.sync += self.halves[p].eq(candidates)
                    candidates = self.halves[p]
                for low, width in digits:
                    values = [key[low : low + width] for key in self.keys]
                    candidates = smallest(m, candidates, values, f"digit{low}")
            found.append(candidates)
        # Pairs: an entry is in the set, and one more is.
        pairs = [(bit, Const(0, 1)) for bit in self.sets[-1]]
        _, more = tree(lambda a, b: (a[0] | b[0], a[1] | b[1] | (a[0] & b[0])), pairs)
        m.d.sync += self.single.eq(~more)
        return found

    def _load(self, m: Module):
        """Store an entry in the next slot."""
        push = self.i.valid & self.i.ready
        for k, key in enumerate(self.keys):
            with m.If(push & (self.slot == k)):
                m.d.sync += [key.eq(self.i.payload.key), self.sets[0][k].eq(1)]
        with m.If(push):
            m.d.sync += self.slot.eq(Mux(self.i.payload.last, 0, self.slot + 1))
            m.d.sync += self.full[0].eq(self.i.payload.last)

    def _give(self, m: Module, candidates: Value, ends: Value, last: Value):
        """Look the entry up; the memory holds its answer while the entry is offered."""
        m.submodules.memory = memory = Memory(
            shape=self.config.sort_key_bits, depth=self.entries, init=[]
        )
        write, read = memory.write_port(), memory.read_port()
        index, give = self.index, self.give
        m.d.comb += [
            index.eq(lowest_index(m, candidates)),
            give.eq(ends & self.full[-1]),
            write.addr.eq(self.slot),
            write.data.eq(self.i.payload.key),
            write.en.eq(self.i.valid & self.i.ready),
            read.addr.eq(index),
            read.en.eq(give),
            self.o.payload.key.eq(read.data),
        ]
        with m.If(give):
            m.d.sync += [self.o.payload.index.eq(index), self.o.payload.last.eq(last)]
        with m.If(give | self.o.ready):
            m.d.sync += self.o.valid.eq(give)
