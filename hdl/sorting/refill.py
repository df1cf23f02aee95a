"""Feeds a merge from scratch memory: reads pieces of its runs into the memory it reads from."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import MEMORY_DEPTH_MIN, Queue
from splatcore.hdl.sorting.runs import returned
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, entry_record
from splatcore.spec.sort import half_entries, read_entries, wanted_record


class Refill(wiring.Component):
    """Reads neighbouring runs of a length from scratch memory, as `spec.sort` says.

    Members
        start: the runs from `base` on are to be merged; length (a power of two), total: that of a
            run and of the list; area: where they are.
        begin: `runs` is the set of runs that there are, and the merge may begin.
        taken: the merge has taken the last entry of a piece from this way.
        stop: what has not been asked for is not needed any more.
        wanted: stream of `wanted_record`; back: stream of `entry_record`, their entries.
        returned: these, for the half.
        busy: something is to be asked for, or has not come back.

    **Timing**: a piece every 3 cycles, an entry in per cycle. Memories: a way's next position, and
    ways that wait for their piece or have asked for one, a row for each piece that there is room
    for, so that neither can be full.
    """

    def __init__(self, config: Config):
        self.config = config
        self.piece, self.pieces = read_entries(config), half_entries(config) // read_entries(config)
        self.way = range(config.merge_ways)
        wanted = layout(wanted_record(config))
        ports = {
            "start": In(1),
            "base": In(COUNT_BITS),
            "length": In(COUNT_BITS + 1),
            "total": In(COUNT_BITS),
            "area": In(1),
            "begin": Out(1),
            "runs": Out(config.merge_ways),
            "taken": In(data.StructLayout({"valid": 1, "way": self.way})),
            "stop": In(1),
            "wanted": Out(stream.Signature(wanted)),
            "back": In(stream.Signature(layout(entry_record(config)))),
            "returned": Out(returned(config)),
            "busy": Out(1),
        }
        super().__init__(ports)
        asked = data.StructLayout({"way": self.way, "last": 1, "count": wanted["count"].shape})
        self.ready = Queue(self.way, max(MEMORY_DEPTH_MIN, self.pieces), memory=True)
        self.under_way = Queue(asked, max(MEMORY_DEPTH_MIN, self.pieces), memory=True)
        self.current = Signal(self.way)  # the way that asks
        self.first = Signal()  # for its run's first piece
        self.start_of_run = Signal(COUNT_BITS + 1)
        self.ended, self.looks, self.steps = Signal(), Signal(), Signal()

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.ready, m.submodules.under_way = self.ready, self.under_way
        m.d.comb += self.ready.i.valid.eq(self.taken.valid)
        m.d.comb += self.ready.i.payload.eq(self.taken.way)
        self._position(m)
        idle = self._ask(m)
        m.d.comb += self.busy.eq(~idle | (self.ready.level != 0) | (self.under_way.level != 0))
        self._return(m)
        return m

    def _position(self, m: Module):
        """The next piece of the way that asks: its address and length."""
        ways = self.config.merge_ways
        m.submodules.next_ones = memory = Memory(shape=COUNT_BITS + 1, depth=ways, init=[])
        write, read = memory.write_port(), memory.read_port()
        position, after = Signal(COUNT_BITS + 1), Signal(COUNT_BITS + 1)
        wanted, asked = self.wanted.payload, self.under_way.i.payload
        rest = Signal(COUNT_BITS + 1)  # of the list, if it has not ended
        m.d.sync += position.eq(Mux(self.first, self.start_of_run, read.data))
        m.d.comb += [
            after.eq(position + self.piece),
            self.ended.eq((position >= self.total) | (~self.first & self._between(position))),
            read.addr.eq(self.current),
            read.en.eq(self.looks),
            write.addr.eq(self.current),
            write.data.eq(Mux(self.ended, position, after)),
            write.en.eq(self.steps),
            wanted.address.eq(Cat(position[:COUNT_BITS], self.area)),
            rest.eq(self.total - position),
            wanted.count.eq(Mux(rest < self.piece, rest, self.piece)),
            asked.way.eq(self.current),
            asked.last.eq((rest <= self.piece) | self._between(after)),
            asked.count.eq(wanted.count),
        ]

    def _ask(self, m: Module) -> Value:
        """Way by way, as often as there is room for a piece of each; then as room comes free.

        Returns a bit that says that nothing is being asked for.
        """
        rounds = self.pieces // self.config.merge_ways
        ready, under_way, way = self.ready, self.under_way, self.current
        filling, left = Signal(), Signal(range(rounds))
        m.d.sync += self.begin.eq(0)
        with m.FSM() as fsm:
            with m.State("IDLE"):
                m.d.comb += ready.o.ready.eq(~self.start)
                m.d.sync += way.eq(ready.o.payload)
                with m.If(self.start):
                    m.d.sync += [filling.eq(1), self.first.eq(1), way.eq(0), left.eq(rounds - 1)]
                    m.d.sync += self.start_of_run.eq(self.base)
                    m.next = "LOOK"
                with m.Elif(self.stop):
                    m.next = "DRAIN"
                with m.Elif(ready.o.valid):
                    m.next = "LOOK"
            with m.State("LOOK"):
                m.d.comb += self.looks.eq(1)
                m.next = "FIND"
                with m.If(self.stop):
                    m.next = "DRAIN"
            with m.State("FIND"):  # what has been looked up becomes `position`
                m.next = "ASK"
            with m.State("ASK"):
                m.d.comb += self.wanted.valid.eq(~self.ended & under_way.i.ready)
                m.d.comb += under_way.i.valid.eq(self.wanted.valid & self.wanted.ready)
                m.d.comb += self.steps.eq(self.ended | under_way.i.valid)
                with m.If(self.steps):
                    m.next = "IDLE"
                    with m.If(filling):
                        m.next = "LOOK"
                        m.d.sync += way.eq(way + 1)
                    with m.If(self.first):
                        m.d.sync += self.runs.bit_select(way, 1).eq(~self.ended)
                        with m.If(~self.ended):
                            m.d.sync += self.start_of_run.eq(self.start_of_run + self.length)
                    with m.If(filling & way.all()):
                        m.d.sync += [self.first.eq(0), left.eq(left - 1), self.begin.eq(self.first)]
                        with m.If(left == 0):
                            m.d.sync += filling.eq(0)
                            m.next = "IDLE"
            with m.State("DRAIN"):
                m.d.comb += ready.o.ready.eq(1)
                m.d.sync += [filling.eq(0), self.first.eq(0)]
                with m.If((under_way.level == 0) & (ready.level == 0)):
                    m.next = "IDLE"
        return fsm.ongoing("IDLE")

    def _between(self, position: Value) -> Value:
        """High if a run begins at a position."""
        return (position & (self.length - 1)[: len(position)]) == 0

    def _return(self, m: Module):
        """Entries that come back; they belong to the piece that was asked for first."""
        asked = self.under_way.o
        number = Signal.like(self.wanted.payload.count)
        last = number + 1 == asked.payload.count
        back, entry = self.back, self.back.payload
        m.d.comb += [
            back.ready.eq(asked.valid),
            asked.ready.eq(back.valid & last),
            self.returned.valid.eq(back.valid & back.ready),
            self.returned.way.eq(asked.payload.way),
            self.returned.last.eq(asked.payload.last & last),
            self.returned.entry.eq(entry),
        ]
        with m.If(self.returned.valid):
            m.d.sync += number.eq(Mux(last, 0, number + 1))
