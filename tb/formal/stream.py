"""Properties to prove of every stream primitive, with their induction invariants.

One item is followed through the part. `pick` is free, so the proof covers every item. No part looks
at its payload, so a few bits stand for any width.
"""

from collections.abc import Callable
from functools import partial

from amaranth.hdl import Assert, Assume, Cat, Const, Cover, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import Fork, Pipe, Queue, Register, Slot, Stage
from tb.formal.axi_rules import Around
from tb.formal.proof import side_by_side
from tb.helpers.parts import Piped
from tb.planted.fault import planted_in

WIDTH = 3  # bits of the payload in proofs


class Followed(Around):
    """A part with streams `i` and `o` that holds up to `capacity` items; one item is followed.

    Asserts:
    - an offer is kept;
    - items come out in order, once and unchanged, and no others;
    - at most `capacity` items fit;
    - with an item inside, fewer than `latency` cycles pass without an offer, so none is lost;
    - an empty part accepts an item.

    The input side need not keep its offers. Reset is free, so all this holds after any reset.
    """

    def __init__(self, part: wiring.Component, invariant: Callable, latency: int, capacity: int):
        super().__init__(part, pick=In(1))
        self.invariant, self.latency, self.capacity = invariant, latency, capacity
        self.inside = Signal(range(capacity + 2))  # items that went in and have not come out
        self.followed = Signal()  # an item inside is being followed:
        self.value = Signal(WIDTH)  # its payload,
        self.ahead = Signal(range(capacity + 1))  # how many leave before it
        self.idle = Signal(range(latency + 1))  # cycles since the last offer with an item inside

    def elaborate(self, platform) -> Module:
        m, i, o = self.placed(), self.inner.i, self.inner.o
        put, take, picked, leaves = Signal(), Signal(), Signal(), Signal()
        m.d.comb += [put.eq(i.valid & i.ready), take.eq(o.valid & o.ready)]
        m.d.comb += picked.eq(put & self.pick & ~self.followed)
        m.d.comb += leaves.eq(self.followed & o.valid & (self.ahead == 0))
        m.d.sync += self.inside.eq(self.inside + put - take)
        m.d.sync += self.idle.eq(Mux((self.inside != 0) & ~o.valid, self.idle + 1, 0))
        with m.If(self.followed & take):
            m.d.sync += [self.ahead.eq(self.ahead - 1), self.followed.eq(~leaves)]
        with m.If(picked):
            m.d.sync += [self.followed.eq(1), self.value.eq(i.payload)]
            m.d.sync += self.ahead.eq(self.inside - take)
        m.d.comb += [
            Assert(~o.valid | (self.inside != 0)),
            Assert(~leaves | (o.payload == self.value)),
            Assert(self.inside <= self.capacity),
            Assert(self.idle < self.latency),
            Assert(i.ready | (self.inside != 0)),
            Assert(~self.followed | (self.ahead < self.inside)),
            Cover(leaves & o.ready & (self.value == 1)),
        ]
        keeps_offers(m, o)
        self.invariant(self, m, picked)
        return m


def keeps_offers(m: Module, o, check=Assert) -> Signal:
    """Assert (or assume) that an offer on `o` is kept; returns whether one is open."""
    offered, payload = Signal(), Signal(WIDTH)
    m.d.sync += [offered.eq(o.valid & ~o.ready), payload.eq(o.payload)]
    m.d.comb += check(~offered | (o.valid & (o.payload == payload)))
    return offered


# Why it holds: the place of the followed item in each part's registers. Parameters: the proof, the
# module to assert in, and whether the followed item enters in this cycle.


def in_register(proof: Followed, m: Module, picked: Value) -> None:
    part = proof.inner
    place = Mux(proof.ahead == 0, part.head, part.spare)
    m.d.comb += [
        Assert(proof.inside == part.o.valid + part.full),
        Assert(part.o.valid | ~part.full),
        Assert(part.i.ready == (proof.inside != proof.capacity)),
        Assert(~proof.followed | (place == proof.value)),
    ]


def in_slot(proof: Followed, m: Module, picked: Value) -> None:
    part = proof.inner
    m.d.comb += [
        Assert(proof.inside == part.o.valid),
        Assert(part.i.ready == ~part.o.valid),
        Assert(~proof.followed | (part.o.payload == proof.value)),
    ]


def in_stage(proof: Followed, m: Module, picked: Value) -> None:
    part = proof.inner
    m.d.comb += [
        Assert(proof.inside == part.o.valid),
        Assert(part.i.ready == (~part.o.valid | part.o.ready)),
        Assert(~proof.followed | (part.o.payload == proof.value)),
    ]


class WatchedQueue(Queue):
    """A queue with an extra read port for its rows: `row` in, `content` out."""

    def __init__(self, depth: int, memory: bool = False):
        super().__init__(WIDTH, depth, memory=memory)
        self.row, self.content, self.clash = Signal(range(depth)), Signal(WIDTH), Signal()

    def elaborate(self, platform) -> Module:
        m = super().elaborate(platform)
        storage = m.submodules.storage
        read, write = storage.read_ports[0], storage.write_ports[0]
        watch = storage.read_port(domain="comb")
        m.d.comb += [watch.addr.eq(self.row), self.content.eq(watch.data)]
        if self.memory:
            m.d.comb += self.clash.eq(read.en & write.en & (read.addr == write.addr))
        return m


def in_queue(proof: Followed, m: Module, picked: Value) -> None:
    part = proof.inner
    waits = proof.followed & ~(part.memory & part.o.valid & (proof.ahead == 0))
    content = in_rows(m, part, proof.ahead)
    m.d.comb += [
        Assert(proof.inside == part.level),
        Assert(part.i.ready == (proof.inside != proof.capacity)),
        Assert(~waits | (content == proof.value)),
    ]


def in_rows(m: Module, part: WatchedQueue, ahead: Value) -> Value:
    """Check a queue's rows and pointers; returns the row of the item behind `ahead` others."""
    head = part.o.valid if part.memory else 0  # items that have left their rows already
    row = part.read + ahead - head
    end = part.read + part.level - head
    m.d.comb += [
        part.row.eq(Mux(row < part.depth, row, row - part.depth)),
        Assert(part.level >= part.o.valid),
        Assert((part.read < part.depth) & (part.write < part.depth)),
        Assert(part.write == Mux(end < part.depth, end, end - part.depth)),
        Assert(~part.clash),
    ]
    return part.content


def in_pipe(proof: Followed, m: Module, picked: Value) -> None:
    part, pipe = proof.inner, proof.inner.pipe
    stages = Signal(pipe.valid.shape())  # one-hot: stage of the followed item
    with m.If(pipe.enable):
        m.d.sync += stages.eq(Cat(picked, stages))
    m.d.comb += Assert(proof.inside == sum(pipe.valid))
    m.d.comb += Assert(part.i.ready == (~part.o.valid | part.o.ready))
    m.d.comb += [Assert(proof.followed == stages.any()), Assert((stages & (stages - 1)) == 0)]
    for k, data in enumerate(part.data):
        ahead = sum(pipe.valid[k + 1 :], Const(0))
        here = pipe.valid[k] & (data == proof.value) & (proof.ahead == ahead)
        m.d.comb += [
            Assert(~stages[k] | here),
            # After k cycles without an offer, the oldest item has advanced by at least k stages.
            Assert((proof.idle != k) | pipe.valid[k:].any() | (proof.inside == 0)),
        ]


class Forked(Around):
    """A fork: each output offers each item once, whatever the others do, and keeps its offers.

    Assumes that the input side keeps its offers, too, as the fork requires.
    """

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        had, taking = Signal(len(part.o)), Signal(len(part.o))  # outputs that had it, take it
        offered = keeps_offers(m, part.i, Assume)
        for k, o in enumerate(part.o):
            m.d.comb += taking[k].eq(o.valid & o.ready)
            m.d.comb += Assert(o.valid == (part.i.valid & ~had[k]))
            m.d.comb += Assert(~o.valid | (o.payload == part.i.payload))
            keeps_offers(m, o)
        passes = part.i.valid & part.i.ready
        m.d.sync += had.eq(Mux(passes, 0, had | taking))
        m.d.comb += Assert(passes == (part.i.valid & (had | taking).all()))
        m.d.comb += [Assert(part.taken == had), Assert(offered | (had == 0))]
        m.d.comb += Cover(passes & had.any())
        return m


def queue(depth: int, memory: bool = False) -> Followed:
    return Followed(WatchedQueue(depth, memory), in_queue, latency=1 + memory, capacity=depth)


def pipe(latency: int) -> Followed:
    return Followed(Piped(WIDTH, latency), in_pipe, latency, capacity=latency)


PARTS = {
    "register": lambda: Followed(Register(WIDTH), in_register, latency=1, capacity=2),
    "slot": lambda: Followed(Slot(WIDTH), in_slot, latency=1, capacity=1),
    "stage": lambda: Followed(Stage(WIDTH), in_stage, latency=1, capacity=1),
    **{f"queue_{depth}": partial(queue, depth) for depth in (2, 5)},  # 5: not a power of two
    **{f"memory_{depth}": partial(queue, depth, True) for depth in (3, 8)},
    **{f"pipe_{latency}": partial(pipe, latency) for latency in (1, 4)},
    "fork": lambda: Forked(Fork(WIDTH, 3)),
}

FAULTS = {
    "register": (Register, "an item too many", "self.i.ready.eq(~self.full)", "self.i.ready.eq(1)"),
    "slot": (Slot, "taken while full", "self.i.ready.eq(ready)", "self.i.ready.eq(1)"),
    "stage": (Stage, "lost to the next", "~self.o.valid | self.o.ready", "1"),
    "queue_5": (Queue, "full too late", "self.level != self.depth", "self.level <= self.depth"),
    "memory_3": (Queue, "fetched from nowhere", "self.level != self.o.valid", "1"),
    "pipe_4": (Pipe, "halts too late", "~self.o.valid | self.o.ready", "1"),
    "fork": (Fork, "given twice", "self.i.valid & ~self.taken[k]", "self.i.valid"),
}

PROOF = side_by_side(
    PARTS,
    {
        part: planted_in(kind, elaborate={fault: (old, new)})
        for part, (kind, fault, old, new) in FAULTS.items()
    },
    cover=8,  # cycles in which an item can enter and leave each part
)
