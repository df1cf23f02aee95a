"""Stream primitives between stages and around datapaths: register, slot, stage, queue, fork, pipe.

Streams are Amaranth's (`lib.stream`): an item passes in a cycle in which valid and ready are both
high; a producer that has raised valid holds valid and payload until then. All outputs here keep
that rule; only `Fork` relies on it at its input. Payload registers are not reset, which saves an
AND gate per bit, and load only when something valid moves into them, so that their clock can be
gated.

In this file a path is a combinational one, from an input to an output in the same cycle.
"""

from amaranth.hdl import Cat, Module, Mux, ShapeLike, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect

MEMORY_DEPTH_MIN = 3
"""Minimum depth of a queue in a synchronous memory: an item takes two cycles to pass it."""

HANDSHAKE = wiring.Signature({"valid": Out(1), "ready": In(1)})  # a stream without its payload


def passes(stream: stream.Interface) -> Value:
    """High in a cycle in which an item passes."""
    return stream.valid & stream.ready


def judged(m: Module, offer: stream.Interface, keep: Value) -> tuple[Signal, Signal]:
    """Registered keep/drop decision for an offered item, one cycle late, with its valid bit.

    offer: its item must stay offered one more cycle, so `keep` has a whole cycle to settle
    keep: the decision, combinational from the offer
    Returns the decision and its valid bit.
    """
    kept, known = Signal(name="kept"), Signal(name="known")
    m.d.sync += [kept.eq(keep), known.eq(offer.valid & ~offer.ready)]
    return kept, known


class Register(wiring.Component):
    """Two registers that cut every path between `i` and `o`.

    The second register takes the item that is in flight when the output stalls.

    Internal:
        head, spare: the item at `o`, and the one behind it
        full: `spare` holds an item

    **Timing**: latency 1, one item per cycle, no path; two items' flip-flops, no multiplier.
    """

    HOLDS = 2  # items

    def __init__(self, shape: ShapeLike):
        super().__init__({"i": In(stream.Signature(shape)), "o": Out(stream.Signature(shape))})
        self.head = Signal(shape, reset_less=True)
        self.spare = Signal(shape, reset_less=True)
        self.full = Signal()

    def elaborate(self, platform) -> Module:
        m = Module()
        m.d.comb += [self.i.ready.eq(~self.full), self.o.payload.eq(self.head)]
        with m.If(~self.o.valid | self.o.ready):
            m.d.sync += [self.o.valid.eq(self.full | self.i.valid), self.full.eq(0)]
            with m.If(self.full | self.i.valid):
                m.d.sync += self.head.eq(Mux(self.full, self.spare, self.i.payload))
        with m.Elif(~self.full & self.i.valid):
            m.d.sync += [self.spare.eq(self.i.payload), self.full.eq(1)]
        return m


class Slot(wiring.Component):
    """One register that cuts every path between `i` and `o`, for rare items.

    `i.ready` is a flip-flop, so it can drive long combinational logic.

    **Timing**: latency 1, one item every other cycle, no path; no multiplier.
    """

    def __init__(self, shape: ShapeLike):
        super().__init__({"i": In(stream.Signature(shape)), "o": Out(stream.Signature(shape))})

    def elaborate(self, platform) -> Module:
        m = Module()
        item, ready = Signal(self.o.payload.shape(), reset_less=True), Signal(init=1)
        m.d.comb += [self.i.ready.eq(ready), self.o.payload.eq(item)]
        with m.If(ready & self.i.valid):
            m.d.sync += [item.eq(self.i.payload), self.o.valid.eq(1), ready.eq(0)]
        with m.Elif(self.o.ready):
            m.d.sync += [self.o.valid.eq(0), ready.eq(1)]
        return m


class Stage(wiring.Component):
    """One register, which takes an item in the cycle in which it passes one on.

    **Timing**: latency 1, one item per cycle. A path from `o.ready` to `i.ready`. No multiplier.
    """

    def __init__(self, shape: ShapeLike):
        super().__init__({"i": In(stream.Signature(shape)), "o": Out(stream.Signature(shape))})

    def elaborate(self, platform) -> Module:
        m = Module()
        item = Signal(self.o.payload.shape(), reset_less=True)
        m.d.comb += [self.i.ready.eq(~self.o.valid | self.o.ready), self.o.payload.eq(item)]
        with m.If(self.i.ready):
            m.d.sync += self.o.valid.eq(self.i.valid)
            with m.If(self.i.valid):
                m.d.sync += item.eq(self.i.payload)
        return m


class Queue(wiring.Component):
    """A queue of exactly `depth` items, two or more, in flip-flops or in a synchronous memory.

    With `memory` its rows are in a memory with one write port and one read port that answers a
    cycle later and holds its answer, like on-chip SRAM; no row is written and read in the same
    cycle. Such a queue is at least `MEMORY_DEPTH_MIN` deep.

    Internal:
        write, read: rows of the next write and of the next read

    **Timing**: latency 1, with `memory` 2; one item per cycle. No path, no multiplier.
    """

    def __init__(self, shape: ShapeLike, depth: int, *, memory: bool = False):
        depth_min = MEMORY_DEPTH_MIN if memory else 2
        if depth < depth_min:
            raise ValueError(f"a queue of depth {depth}, below {depth_min}")
        ports = {
            "i": In(stream.Signature(shape)),
            "o": Out(stream.Signature(shape)),
            # number of items inside, including the one at `o`, 0 … `depth`
            "level": Out(range(depth + 1)),
        }
        super().__init__(ports)
        self.shape, self.depth, self.memory = shape, depth, memory
        self.write = Signal(range(depth))
        self.read = Signal(range(depth))

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.storage = storage = Memory(shape=self.shape, depth=self.depth, init=[])
        write = storage.write_port()
        read = storage.read_port(domain="sync" if self.memory else "comb")
        push, pop, fetch = Signal(), Signal(), Signal()
        m.d.comb += [
            self.i.ready.eq(self.level != self.depth),
            push.eq(self.i.valid & self.i.ready),
            pop.eq(self.o.valid & self.o.ready),
            write.addr.eq(self.write),
            write.data.eq(self.i.payload),
            write.en.eq(push),
            read.addr.eq(self.read),
            self.o.payload.eq(read.data),
        ]
        if self.memory:
            # The memory's output register is the head of the queue; all other items are in rows.
            m.d.comb += fetch.eq((self.level != self.o.valid) & (~self.o.valid | self.o.ready))
            m.d.comb += read.en.eq(fetch)
            with m.If(fetch | pop):
                m.d.sync += self.o.valid.eq(fetch)
        else:
            m.d.comb += [fetch.eq(pop), self.o.valid.eq(self.level != 0)]
        with m.If(push):
            m.d.sync += self.write.eq(self._next(self.write))
        with m.If(fetch):
            m.d.sync += self.read.eq(self._next(self.read))
        with m.If(push != pop):
            m.d.sync += self.level.eq(Mux(push, self.level + 1, self.level - 1))
        return m

    def _next(self, row: Value) -> Value:
        """The row after `row`, with wrap-around."""
        return Mux(row == self.depth - 1, 0, row + 1)


def soon(m: Module, name: str, answer: stream.Interface, logic: str) -> stream.Interface:
    """Output of a memory, for logic that starts with it.

    On an FPGA it is behind a register, submodule `name`, because block RAM answers late in the
    cycle.
    """
    if logic == "gates":
        return answer
    m.submodules[name] = stage = Stage(answer.payload.shape())
    connect(m, answer, stage.i)
    return stage.o


class Fork(wiring.Component):
    """Copies every item to each of `count` outputs, each of which takes it at its own pace.

    Internal:
        taken: outputs that have had the item at `i`

    **Timing**: latency 0, one item per cycle. Paths from `i` to all outputs and from every
    `o.ready` to `i.ready`. No multiplier.
    """

    def __init__(self, shape: ShapeLike, count: int):
        if count < 1:
            raise ValueError(f"a fork to {count} outputs, below 1")
        ports = {
            "i": In(stream.Signature(shape)),
            # none waits for another to take the same item
            "o": Out(stream.Signature(shape)).array(count),
        }
        super().__init__(ports)
        self.taken = Signal(count)

    def elaborate(self, platform) -> Module:
        m = Module()
        taken = Signal.like(self.taken)
        for k, o in enumerate(self.o):
            m.d.comb += [o.payload.eq(self.i.payload), o.valid.eq(self.i.valid & ~self.taken[k])]
        m.d.comb += taken.eq(self.taken | Cat(o.ready for o in self.o))
        m.d.comb += self.i.ready.eq(taken.all())
        with m.If(self.i.valid):
            m.d.sync += self.taken.eq(Mux(taken.all(), 0, taken))
        return m


class Pipe(wiring.Component):
    """The handshake around a datapath of fixed latency whose registers load when `enable` is high.

    Valid bits travel with the data. The whole pipe stalls while the item at its end is not taken. A
    bubble at its end never stalls it; bubbles further inside stay. A stage connects it to its
    datapath as follows:

        m.submodules.pipe = pipe = Pipe(datapath.latency)
        m.d.comb += [
            pipe.i.valid.eq(self.i.valid),
            self.i.ready.eq(pipe.i.ready),
            self.o.valid.eq(pipe.o.valid),
            pipe.o.ready.eq(self.o.ready),
            datapath.enable.eq(pipe.loads),
        ]

    **Timing**: latency `latency` enabled cycles, one item per cycle. A path from `o.ready` to
    `i.ready` and `enable`; a `Register` behind the pipe cuts it. No multiplier.
    """

    def __init__(self, latency: int):
        if latency < 1:
            raise ValueError(f"a pipe of latency {latency}, below 1")
        ports = {
            "i": In(HANDSHAKE),
            "o": Out(HANDSHAKE),
            "enable": Out(1),  # the items advance at the end of this cycle
            "valid": Out(latency),  # bit k: the registers after k + 1 cycles hold an item
            "loads": Out(latency),  # bit k: an item enters these registers
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.d.comb += [self.o.valid.eq(self.valid[-1]), self.enable.eq(~self.o.valid | self.o.ready)]
        coming = Cat(self.i.valid, self.valid)[: len(self.valid)]
        m.d.comb += [
            self.i.ready.eq(self.enable),
            self.loads.eq(Mux(self.enable, coming, 0)),
        ]
        with m.If(self.enable):
            m.d.sync += self.valid.eq(coming)
        return m
