"""Stage 2: sorts each group's entries by depth key, stably, whatever their number."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.counters import count_events, counters_layout
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.sorting.merge import Merge
from splatcore.hdl.sorting.refill import Refill
from splatcore.hdl.sorting.runs import HALVES, Half, Runs, slot_layout
from splatcore.spec import sort
from splatcore.spec.config import Config
from splatcore.spec.counters import SORT
from splatcore.spec.group import COUNT_BITS, entry_record, sorted_record

COUNTED = tuple(SORT)

OUT_WAITING = 2  # entries that may wait at the end, the one that is being looked up included


class Sort(wiring.Component):
    """Groups' entries in; the same entries in order, and a mark behind each group, out.

    Members
        groups: stream of `count_record`; entries: stream of `entry_record`, those of one group
            after those of the other.
        spill: stream of `spill_record`, entries to be written to scratch memory; wanted: stream of
            `wanted_record`, pieces to be read from there, never before `spill` has given all of
            the run (what was given must be read); back: stream of `entry_record`, their entries.
        stop: the rest of the group that is being given out is not needed. To be held until the
            mark behind the group comes; a few entries may come before it.
        o: stream of `sorted_record`.
        counters, clear: events of `COUNTED`. The last three are cycles: in which a sub-sorter had
            entries, in which a merge waited for one, and for the one before to be taken.

    **Timing**: 2 cycles an entry, and about as many for a group as it has runs, and 14, while the
    next group is being loaded. The first entry comes at least 2·phases + 8 cycles after the last
    one went in. No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        entry = layout(entry_record(config))
        ports = {
            "groups": In(stream.Signature(layout(sort.count_record()))),
            "entries": In(stream.Signature(entry)),
            "spill": Out(stream.Signature(layout(sort.spill_record(config)))),
            "wanted": Out(stream.Signature(layout(sort.wanted_record(config)))),
            "back": In(stream.Signature(entry)),
            "stop": In(1),
            "o": Out(stream.Signature(layout(sorted_record(config)))),
            "clear": In(1),
            "counters": Out(counters_layout(COUNTED)),
        }
        super().__init__(ports)
        given = data.StructLayout({"entry": entry, "spill": 1, "end": 1})
        self.runs, self.merge, self.refill = Runs(config), Merge(config), Refill(config)
        self.given = Queue(given, OUT_WAITING)
        self.halves = [Half(config) for _ in range(HALVES)]
        self.half, self.release = Signal(), Signal()  # whose job is being merged; it is over
        self.clear_runs, self.turns = Signal(), Signal()  # before the next merge from scratch
        self.to_spill, self.reading, self.ends = Signal(), Signal(), Signal()
        self.looking, self.found = Signal(), Signal()  # an entry's value is read, has been read
        self.ending = Signal()  # a group's mark has not been taken yet
        self.position = Signal(COUNT_BITS)  # of the next entry that is spilled
        self.area = Signal()  # that is written

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.runs, m.submodules.merge = self.runs, self.merge
        m.submodules.refill, m.submodules.given = self.refill, self.given
        connect(m, flipped(self).groups, self.runs.groups)
        connect(m, flipped(self).entries, self.runs.entries)
        connect(m, flipped(self).wanted, self.refill.wanted)
        connect(m, flipped(self).back, self.refill.back)
        self._halves(m)
        self._look(m)
        self._give(m)
        self._control(m)
        self._count(m)
        return m

    def _halves(self, m: Module):
        """The merge and the refill work on the half whose turn it is."""
        runs, merge, refill = self.runs, self.merge, self.refill
        for k, half in enumerate(self.halves):
            m.submodules[f"half{k}"] = half
            mine = self.half == k
            m.d.comb += [
                half.arrived.eq(runs.arrived[k]),
                half.ranked.eq(runs.ranked[k]),
                half.returned.eq(refill.returned),
                half.returned.valid.eq(refill.returned.valid & mine),
                half.clear.eq((self.release | self.clear_runs) & mine),
                half.head.eq(merge.head),
                runs.release[k].eq(self.release & mine),
            ]
        first, second = self.halves
        m.d.comb += merge.written.eq(Mux(self.half, second.written, first.written))
        m.d.comb += merge.found.eq(Mux(self.half, second.head_found, first.head_found))
        with m.If(self.release):
            m.d.sync += self.half.eq(~self.half)

    def _look(self, m: Module):
        """Values of the entries that the merge gives, a cycle after each other."""
        merge, given = self.merge, self.given.i.payload
        key, slot = Signal(self.config.sort_key_bits), Signal(slot_layout(self.config))
        first, second = self.halves
        piece = sort.read_entries(self.config) - 1
        m.d.sync += [self.looking.eq(merge.o.valid), self.found.eq(self.looking)]
        with m.If(merge.o.valid):
            m.d.sync += [key.eq(merge.o.key), slot.eq(merge.o.slot)]
        m.d.comb += [
            merge.room.eq(self.given.level + self.found < OUT_WAITING),
            first.value.eq(slot),
            second.value.eq(slot),
            given.entry.key.eq(key),
            given.spill.eq(self.to_spill),
            self.given.i.valid.eq(self.found | self.ends),
            self.refill.taken.valid.eq(
                self.looking & self.reading & ((slot.index & piece) == piece)
            ),
            self.refill.taken.way.eq(slot.way),
        ]
        for k, half in enumerate(self.halves):
            with m.If(self.half == k):
                m.d.comb += given.entry.splat.eq(half.value_found.splat)
                m.d.comb += given.entry.mask.eq(half.value_found.mask)
        with m.If(self.ends):
            m.d.comb += [given.end.eq(1), given.spill.eq(0), given.entry.eq(0)]

    def _give(self, m: Module):
        """To the output, or to scratch memory."""
        given = self.given.o
        m.d.comb += [
            self.o.valid.eq(given.valid & ~given.payload.spill),
            self.o.payload.splat.eq(given.payload.entry.splat),
            self.o.payload.mask.eq(given.payload.entry.mask),
            self.o.payload.end.eq(given.payload.end),
            self.spill.valid.eq(given.valid & given.payload.spill),
            self.spill.payload.address.eq(Cat(self.position, self.area)),
            self.spill.payload.entry.eq(given.payload.entry),
            given.ready.eq(Mux(given.payload.spill, self.spill.ready, self.o.ready)),
        ]
        low, high = self.position[: COUNT_BITS // 2], self.position[COUNT_BITS // 2 :]
        with m.If(self.spill.valid & self.spill.ready):
            m.d.sync += low.eq(low + 1)
            with m.If(low.all()):  # a carry through all bits would be too deep
                m.d.sync += high.eq(high + 1)
        with m.If(self.ends):
            m.d.sync += self.ending.eq(1)
        with m.Elif(self.o.valid & self.o.ready & self.o.payload.end):
            m.d.sync += self.ending.eq(0)

    def _control(self, m: Module):
        """Jobs, then levels of merging from scratch memory."""
        merge, refill, job = self.merge, self.refill, Signal(self.runs.jobs[0].shape())
        dropping, stops, aborts, empty, over = (Signal() for _ in range(5))
        m.d.comb += [
            job.eq(Mux(self.half, self.runs.jobs[1], self.runs.jobs[0])),
            stops.eq((self.stop & ~self.ending) | dropping),
            over.eq(~merge.busy & ~self.looking & ~self.found & ~refill.busy),
            empty.eq(over & (self.given.level == 0)),
            merge.runs.eq(Mux(self.reading, refill.runs, (1 << job.runs) - 1)),
            merge.stop.eq(aborts),
            refill.stop.eq(aborts),
        ]
        again, final = self._levels(m)
        with m.FSM():
            with m.State("JOB"):
                m.d.sync += self.to_spill.eq(job.long)
                with m.If(job.ready):
                    m.d.comb += merge.begin.eq(1)
                    m.next = "MERGE"
            with m.State("MERGE"):
                with m.If(refill.begin):
                    m.d.comb += merge.begin.eq(1)
                with m.If(stops):
                    m.next = "ABORT"
                with m.Elif(over):
                    m.next = "END"
                    with m.If(again | (job.long & job.last & ~self.reading)):
                        m.next = "LEVEL"
                    with m.Elif(job.long & ~job.last):
                        m.d.comb += self.release.eq(1)
                        m.next = "JOB"
            with m.State("LEVEL"):  # until all that was spilled has been given
                m.d.comb += self.turns.eq(empty)
                with m.If(empty):
                    m.next = "READ"
            with m.State("READ"):
                m.d.comb += [refill.start.eq(1), self.clear_runs.eq(1)]
                m.d.sync += [self.reading.eq(1), self.to_spill.eq(~final)]
                m.next = "MERGE"
            with m.State("ABORT"):
                m.d.comb += aborts.eq(1)
                with m.If(over):
                    m.next = "END"
                    with m.If(job.long & ~job.last):
                        m.d.comb += self.release.eq(1)
                        m.d.sync += dropping.eq(1)
                        m.next = "JOB"
            with m.State("END"):
                m.d.sync += [dropping.eq(0), self.reading.eq(0)]
                with m.If(empty):
                    m.d.comb += [self.ends.eq(1), self.release.eq(1)]
                    m.next = "JOB"

    def _levels(self, m: Module):
        """The next merge from scratch memory; returns two bits: there is one, it is the last one.

        After jobs have been spilled, and whenever a level is through, areas change their roles.
        """
        refill = self.refill
        base, total = Signal(COUNT_BITS), Signal(COUNT_BITS)
        length = Signal(COUNT_BITS + 1)  # of runs; the last of a list may be shorter
        merged = Signal(COUNT_BITS + sort.way_bits(self.config) + 1)
        again, final, through = Signal(), Signal(), Signal()
        after = Signal.like(merged)  # where this merge ends, known long before it does
        m.d.comb += [
            merged.eq(length << sort.way_bits(self.config)),
            final.eq(merged >= total),
            through.eq(after >= total),
            again.eq(self.reading & self.to_spill),
            refill.base.eq(base),
            refill.length.eq(length),
            refill.total.eq(total),
            refill.area.eq(~self.area),
        ]
        m.d.sync += after.eq(base + merged)
        with m.If(self.turns):
            m.d.sync += base.eq(after)
            with m.If(~self.reading | through):
                m.d.sync += [base.eq(0), self.area.eq(~self.area), self.position.eq(0)]
                m.d.sync += [length.eq(Mux(self.reading, merged, sort.half_entries(self.config)))]
                m.d.sync += total.eq(self.position)
        with m.If(self.ends):
            m.d.sync += [self.position.eq(0), self.area.eq(0)]
        return again, final

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
