"""Properties to prove of one merge of a cascade, with their induction invariants.

One pair of runs, freely chosen, is followed. A proof for arbitrary runs at the input covers all
merges of a cascade: the entries at its input are runs of one, and each merge passes its runs to the
next.
"""

from dataclasses import replace
from unittest.mock import patch

from amaranth.hdl import Array, Assert, Cat, Cover, Module, Mux, Signal, Value
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import Queue, passes
from splatcore.hdl.sorting.cascade import Pair
from splatcore.spec.config import TINY
from tb.formal.axi_rules import Around, kept, within
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

MERGES = {"1": (1, False), "2": (2, False), "4": (4, False), "2 in memory": (2, True)}
"""Entries per merged run, and whether runs wait in memories, as runs of 8 entries and more do."""

SMALL = replace(TINY, sub_sorter_entries=8, sort_digits=(1,) * 8)


class Seen(Queue):
    """A queue with observable items, oldest first; items beyond `level` are undefined."""

    def __init__(self, shape, depth: int, *, memory: bool = False):
        super().__init__(shape, depth, memory=memory)
        self.items = [Signal(shape, name=f"item{k}") for k in range(depth)]

    def elaborate(self, platform) -> Module:
        m = super().elaborate(platform)
        ports = [m.submodules.storage.read_port(domain="comb") for _ in range(self.depth)]
        m.d.comb += [port.addr.eq(row) for row, port in enumerate(ports)]
        rows = Array(Value.cast(port.data) for port in ports)
        head = self.o.valid if self.memory else 0  # the head has left its row
        for k, item in enumerate(self.items):
            row = Signal(range(2 * self.depth + 1), name=f"row{k}")
            m.d.comb += row.eq(self.read + k - head)
            found = rows[Mux(row < self.depth, row, row - self.depth)]
            m.d.comb += Value.cast(item).eq(Mux(head, Value.cast(self.o.payload), found))
            if k:
                m.d.comb += Value.cast(item).eq(found)
        end = self.read + self.level - head
        m.d.comb += [
            Assert((self.read < self.depth) & (self.write < self.depth)),
            Assert(self.write == Mux(end < self.depth, end, end - self.depth)),
            Assert((self.level <= self.depth) & (self.level >= self.o.valid)),
        ]
        return m


def pair(size: int, memory: bool) -> Pair:
    """Return a merge of runs of `size` entries, with observable queues."""
    part = "splatcore.hdl.sorting.cascade"
    from_ = size if memory else size + 1
    with patch(f"{part}.Queue", Seen), patch(f"{part}.MEMORY_FROM", from_):
        return Pair(SMALL, size)


class Merged(Around):
    """A merge, and one pair of runs whose entries are recorded.

    Asserts:
    - the pair leaves after the pairs before it, as one run with the entries of both;
    - each entry is the next one of its run, with its key and, below the run's bit, its index;
    - the other run's head is not smaller, and the first run's head not equal: two sorted runs leave
      as one, and the merge is stable;
    - the last entry is marked as the batch's last exactly if the pair was the batch's last;
    - an offer is kept;
    - while nothing is offered, entries are accepted, so the pair comes to its end; with both heads
      inside, an offer follows within `latency` cycles.

    Assumes nothing; reset may come in any cycle.
    """

    def __init__(self, part: Pair):
        super().__init__(part, pick=In(1))
        self.size, entry = part.size, part.i.payload.shape()
        self.latency = 1 if part.runs[0].memory else 0
        counts = range(part.size + 1)
        self.followed, self.alone = Signal(), Signal()  # a pair is followed; it has no second run
        self.pairs = Signal(4)  # pairs ahead of it
        # Per run of it: entries ahead in its queue, own entries that came and left, all have come.
        self.ahead = [Signal(range(part.runs[0].depth + 1), name=f"ahead{k}") for k in range(2)]
        self.came, self.left = (
            [Signal(counts, name=f"{n}{k}") for k in "01"] for n in ("in", "out")
        )
        self.whole = [Signal(name=f"whole{k}") for k in range(2)]
        self.entries = [
            [Signal(entry, name=f"entry{k}_{j}") for j in range(part.size)] for k in range(2)
        ]

    def elaborate(self, platform) -> Module:
        m = self.placed()
        self._follow(m)
        self._check(m)
        self._why(m)
        self._why_followed(m)
        return m

    def _follow(self, m: Module):
        """Record the pair's entries as they come in, and count them as they leave."""
        part, last = self.inner, self.inner.i.payload.last
        put = passes(part.i)
        picked = put & ~part.turn & (part.count == 0) & self.pick & ~self.followed
        first = picked | (put & self.followed & ~self.whole[0])
        second = put & self.followed & self.whole[0] & ~self.alone & ~self.whole[1]
        over = passes(part.alone.o) & (self.pairs == 0)
        m.d.sync += self.followed.eq(picked | (self.followed & ~over))
        pops = passes(part.alone.o)
        m.d.sync += self.pairs.eq(Mux(picked, part.alone.level, self.pairs) - (pops & ~over))
        with m.If(picked):
            m.d.sync += self.pairs.eq(part.alone.level - pops)
            m.d.sync += self.alone.eq(0)
        for k, comes in enumerate((first, second)):
            pop, came = passes(part.runs[k].o), Mux(picked, 0, self.came[k])
            ends = last | (came == self.size - 1)
            mine = self.ahead[k] == 0
            m.d.sync += self.came[k].eq(came + comes)
            m.d.sync += self.whole[k].eq(Mux(comes, ends, self.whole[k] & ~picked))
            m.d.sync += self.ahead[k].eq(self.ahead[k] - (pop & ~mine))
            m.d.sync += self.left[k].eq(self.left[k] + (pop & mine))
            with m.If(picked):
                m.d.sync += [self.ahead[k].eq(part.runs[k].level - pop), self.left[k].eq(0)]
            for j, entry in enumerate(self.entries[k]):
                with m.If(comes & (came == j)):
                    m.d.sync += entry.eq(part.i.payload)
        with m.If(first):
            m.d.sync += self.alone.eq(last)

    def _check(self, m: Module):
        part, o, size = self.inner, self.inner.o, self.size
        key, index = len(o.payload.key), len(o.payload.index) - 1
        chosen, front = o.payload.index[index], self.followed & (self.pairs == 0)
        mine, ends = o.valid & front, []
        heads = [Array(map(Value.cast, self.entries[k]))[self.left[k]] for k in range(2)]
        inside = [self.left[k] < self.came[k] for k in range(2)]  # the head has come
        rest = [~self.whole[0] | inside[0], ~self.alone & (~self.whole[1] | inside[1])]
        first, second = (head[:key] for head in heads)
        for k, smaller in enumerate((first <= second, second < first)):
            my = mine & (chosen == k)
            found = Cat(o.payload.key, o.payload.index[:index])
            m.d.comb += Assert(~my | (inside[k] & (found == heads[k][: key + index])))
            m.d.comb += Assert(~my | ~rest[1 - k] | (inside[1 - k] & smaller))
            ends.append(self.whole[k] & (self.left[k] + 1 == self.came[k]) & ~rest[1 - k])
        end = Mux(chosen, *reversed(ends))
        batch = self.alone | Array(entry.last for entry in self.entries[1])[self.came[1] - 1]
        empty = (part.alone.level == 0) & (part.runs[0].level == 0)
        m.d.comb += [
            Assert(~mine | self.whole[0]),
            Assert(~mine | (o.payload.last == (end & batch))),
            Assert(~front | (passes(part.alone.o) == (mine & o.ready & end))),
            Assert(~front | o.valid | part.i.ready | (self.latency & (inside[0] | inside[1]))),
            Assert(~empty | part.i.ready),
        ]
        heads = (inside[0] | ~rest[0]) & (inside[1] | ~rest[1])
        within(m, front & self.whole[0] & heads & ~o.valid, self.latency)
        kept(m, o.valid, o.ready, o.payload)
        full = (self.came[0] == size) & (self.came[1] == size) & (first == second)
        m.d.comb += Cover(mine & o.ready & end & full & chosen)
        m.d.comb += Cover(mine & o.ready & end & self.alone & (self.came[0] == size))

    def _why(self, m: Module):
        """Every run inside belongs to a pair, and every pair to an item of the queue `alone`."""
        part, alone = self.inner, self.inner.alone
        lasts = [
            sum((k < q.level) & item.last for k, item in enumerate(q.items)) for q in part.runs
        ]
        seconds = sum((k < alone.level) & ~item for k, item in enumerate(alone.items))
        coming = ~part.turn & (part.count != 0)
        newest = Array(alone.items)[alone.level - 1]
        first, second = part.runs
        m.d.comb += [
            Assert(part.count < self.size),
            Assert(alone.level == lasts[0] + part.over[0]),
            Assert(seconds == lasts[1] + part.over[1] + part.turn),
            Assert(~part.over.any() | ((alone.level != 0) & ~alone.items[0])),
            Assert(~part.over.all()),
            Assert(~part.turn | ((alone.level != 0) & ~newest)),
            Assert(part.turn | (first.level >= part.count)),
        ]
        for queue, open_ in ((first, coming), (second, part.turn & (part.count != 0))):
            end = Array(item.last for item in queue.items)[queue.level - 1]
            m.d.comb += Assert((queue.level == 0) | (end == ~open_))
        # A run that is coming in has its entries behind the last complete run.
        for k, item in enumerate(first.items):
            m.d.comb += Assert(
                ~coming | (k >= first.level) | (k + part.count < first.level) | ~item.last
            )

    def _why_followed(self, m: Module):
        """Places of the followed pair's entries."""
        part, alone, followed = self.inner, self.inner.alone, self.followed
        came, whole, left, ahead = self.came, self.whole, self.left, self.ahead
        coming = followed & (~whole[0] | (~self.alone & ~whole[1]))
        turn, none = whole[0] & ~self.alone, self.pairs == 0
        m.d.comb += [
            Assert(~coming | (part.turn == whole[0])),
            Assert(~coming | (part.count == Mux(whole[0], came[1], came[0]))),
            Assert(~coming | (alone.level == self.pairs + whole[0])),
            Assert(~followed | (alone.level >= self.pairs + whole[0])),
            Assert(~followed | ~whole[0] | (Array(alone.items)[self.pairs] == self.alone)),
            Assert(~followed | (came[0] != 0)),
            Assert(~followed | turn | ((came[1] == 0) & ~whole[1])),
            Assert(~followed | whole[0] | ~self.alone),
        ]
        for k, queue in enumerate(part.runs):
            inside = ahead[k] + came[k] - left[k]
            ends = sum((j < ahead[k]) & item.last for j, item in enumerate(queue.items))
            pairs = self.pairs
            if k:
                pairs = sum((j < self.pairs) & ~item for j, item in enumerate(alone.items))
            over = whole[k] & (left[k] == came[k])
            before = Array(item.last for item in queue.items)[ahead[k] - 1]
            m.d.comb += [
                Assert(~followed | (left[k] <= came[k])),
                Assert(~followed | (came[k] <= self.size)),
                Assert(~followed | ~whole[k] | (came[k] != 0)),
                Assert(~followed | whole[k] | (came[k] < self.size)),
                Assert(~coming | (queue.level == inside)),
                Assert(~followed | (queue.level >= inside)),
                Assert(~followed | none | (ends + part.over[k] == pairs)),
                Assert(~followed | ~none | ((ahead[k] == 0) & (part.over[k] == over))),
                Assert(~followed | none | (left[k] == 0)),
                Assert(~followed | (ahead[k] == 0) | before),
            ]
            for j, item in enumerate(queue.items):
                mine = followed & (j >= ahead[k]) & (j < inside)
                place = (j - ahead[k] + left[k])[: len(came[k])]
                entry = Array(map(Value.cast, self.entries[k]))[place]
                end = whole[k] & (place == came[k] - 1)
                m.d.comb += Assert(~mine | (Value.cast(item.entry) == entry))
                m.d.comb += Assert(~mine | (item.last == end))
        last = Array(entry.last for entry in self.entries[1])[came[1] - 1]
        gone = followed & none & part.over[1]
        m.d.comb += Assert(~gone | (part.last == last))


FAULTS = planted_in(
    Pair,
    _merge={
        "a later entry wins a tie": ("entry.key < first", "entry.key <= first"),
        "a run alone waits": ("& ~pair.payload", ""),
        "a pair is not over": ("second.payload.last & ~left[0]", "second.payload.last"),
        "a batch's end is lost": ("pair.payload | Mux(", "Mux("),
        "the second run's index": ("entry.index, chosen", "entry.index, 0"),
        "the second run's end is forgotten": ("eq(second.payload.entry.last)", "eq(0)"),
        "a head that has not come": ("(~left[1] | second.valid)", "1"),
    },
    _push={
        "a run too long": ("self.size - 1", "self.size"),
        "the next batch's runs are paired": ("~turn & ~i.payload.last", "~turn"),
        "a run for the other queue": ("Mux(turn, self", "Mux(~turn, self"),
    },
)

DEPTH = 10  # cycles within which two full runs can be merged, and every fault shows


def part(merge: str, **about) -> Part:
    return Part(lambda: Merged(pair(*MERGES[merge])), **about)


PROOF = Proof(
    {
        merge: part(merge, cover=DEPTH if merge == "2" else None, verify=merge == "4")
        for merge in MERGES
    },
    FAULTS,
    {"": part("2", search=DEPTH)},
)
