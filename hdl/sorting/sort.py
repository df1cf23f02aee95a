"""Stage 2: sorts the entries of jobs by depth key, stably."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.counters import count_events, counters_layout
from splatcore.hdl.lib.holds import enough, never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.sorting.merge import Merge
from splatcore.hdl.sorting.runs import Half, Runs, slot_layout
from splatcore.hdl.sorting.sorter import HALVES
from splatcore.spec.config import Config
from splatcore.spec.counters import SORT
from splatcore.spec.group import entry_record, sorted_record
from splatcore.spec.sort import job_record

COUNTED = tuple(SORT)

OUT_WAITING = 2  # entries that may wait at the output, including the one being looked up
LOOK_UP = 2  # cycles from the merge to the output queue


class Sort(wiring.Component):
    """Sorts the entries of jobs; outputs them in order, with a mark behind each group.

    **Timing**: two cycles per entry; a job takes about 14 cycles and one per run in addition, while
    the next job is loaded. The first entry leaves at least 2·phases + 8 cycles after the last one
    came. No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        enough(Merge.INTERVAL, LOOK_UP, "cycles between entries, so that `room` counts each")
        entry = layout(entry_record(config))
        ports = {
            "jobs": In(stream_of(job_record(config))),
            "entries": In(stream.Signature(entry)),  # `entry_record`, job by job
            # the rest of the group at `o` is not needed; hold it until the group's mark comes; a
            # few entries may come before the mark
            "stop": In(1),
            "released": Out(1),  # a job is over; all its entries were taken
            "o": Out(stream_of(sorted_record(config))),
            "clear": In(1),  # all counters are 0
            # counts of `COUNTED`; the last three count cycles in which a sub-sorter had entries, in
            # which a merge waited for an entry, and in which it waited for room at `o`
            "counters": Out(counters_layout(COUNTED)),
        }
        super().__init__(ports)
        self.runs, self.merge = Runs(config), Merge(config)
        self.given = Queue(layout(sorted_record(config)), OUT_WAITING)
        self.halves = [Half(config) for _ in range(HALVES)]
        self.half, self.ends = Signal(), Signal()  # half being merged; a mark is output
        self.looking, self.found = Signal(), Signal()  # an entry's value is read, has been read
        self.ending = Signal()  # a group's mark has not been taken yet

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.runs, m.submodules.merge = self.runs, self.merge
        m.submodules.given = self.given
        connect(m, flipped(self).jobs, self.runs.i)
        connect(m, flipped(self).entries, self.runs.entries)
        connect(m, self.given.o, flipped(self).o)
        self._halves(m)
        self._look(m)
        self._control(m)
        self._count(m)
        return m

    def _halves(self, m: Module):
        """Connect the merge to the half whose turn it is."""
        runs, merge = self.runs, self.merge
        for k, half in enumerate(self.halves):
            m.submodules[f"half{k}"] = half
            over = self.released & (self.half == k)
            m.d.comb += [
                half.arrived.eq(runs.arrived[k]),
                half.ranked.eq(runs.ranked[k]),
                half.clear.eq(over),
                half.head.valid.eq(merge.head.valid & (self.half == k)),
                half.head.slot.eq(merge.head.slot),
                runs.release[k].eq(over),
            ]
        first, second = self.halves
        # One cycle late; a job begins when its half has been selected for a cycle.
        m.d.sync += merge.written.eq(Mux(self.half, second.written, first.written))
        m.d.comb += merge.found.eq(Mux(self.half, second.head_found, first.head_found))
        with m.If(self.released):
            m.d.sync += self.half.eq(~self.half)

    def _look(self, m: Module):
        """Look up the values of the entries that leave the merge, one cycle after the other."""
        merge, given = self.merge, self.given.i.payload
        slot = Signal(slot_layout(self.config))
        m.d.sync += [self.looking.eq(merge.o.valid), self.found.eq(self.looking)]
        with m.If(merge.o.valid):
            m.d.sync += slot.eq(merge.o.slot)
        m.d.comb += [
            merge.room.eq(self.given.level + self.found < OUT_WAITING),
            self.given.i.valid.eq(self.found | self.ends),
        ]
        for k, half in enumerate(self.halves):
            m.d.comb += [
                half.value.valid.eq(self.looking & (self.half == k)),
                half.value.slot.eq(slot),
            ]
            with m.If((self.half == k) & ~self.ends):
                m.d.comb += given.splat.eq(half.value_found.splat)
                m.d.comb += given.mask.eq(half.value_found.mask)
        m.d.comb += given.end.eq(self.ends)
        never_waits(m, "given", self.given.i, "a sorted entry: OUT_WAITING")
        with m.If(self.ends):
            m.d.sync += self.ending.eq(1)
        with m.Elif(self.o.valid & self.o.ready & self.o.payload.end):
            m.d.sync += self.ending.eq(0)

    def _control(self, m: Module):
        """Process job after job; the rest of a group that is stopped is dropped."""
        merge, job = self.merge, Signal(self.runs.jobs[0].shape())
        dropping, over = Signal(), Signal()
        m.d.comb += [
            job.eq(Mux(self.half, self.runs.jobs[1], self.runs.jobs[0])),
            over.eq(~merge.busy & ~self.looking & ~self.found),
            merge.runs.eq((1 << job.runs) - 1),
        ]
        with m.FSM():
            with m.State("JOB"), m.If(job.ready):
                m.d.comb += merge.begin.eq(1)
                m.next = "MERGE"
            with m.State("MERGE"):
                m.d.comb += merge.stop.eq(dropping)
                with m.If(self.stop & ~self.ending):
                    m.d.sync += dropping.eq(1)
                with m.If(over):
                    m.d.comb += self.released.eq(~job.last)
                    m.next = "JOB"
                    with m.If(job.last):
                        m.next = "END"
            with m.State("END"):
                m.d.sync += dropping.eq(0)
                with m.If(self.given.i.ready):
                    m.d.comb += [self.ends.eq(1), self.released.eq(1)]
                    m.next = "JOB"

    def _count(self, m: Module):
        o = self.o
        events = {
            "entries": self.entries.valid & self.entries.ready,
            "given": o.valid & o.ready & ~o.payload.end,
            "sorting": self.runs.sorting,
            "starved": self.merge.starved,
            "blocked": self.merge.blocked,
        }
        count_events(m, self, events)
