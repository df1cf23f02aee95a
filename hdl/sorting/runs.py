"""Stage 2: cuts jobs into batches, has them sorted into runs, and keeps the runs in memory."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.sorting.sorter import HALVES, Sorter
from splatcore.hdl.sorting.subsort import any_of
from splatcore.spec.config import Config
from splatcore.spec.group import entry_record
from splatcore.spec.record import Record
from splatcore.spec.sort import half_entries, index_bits, job_record, ranked_record


def value_record(config: Config) -> Record:
    """The payload of an entry: the fields that sorting ignores."""
    entry = entry_record(config)
    return Record("value", {field: entry[field] for field in ("splat", "mask")})


def slot_layout(config: Config) -> data.StructLayout:
    """Address of a word of a half's memories: a way (its run), and the index within it."""
    return data.StructLayout({"index": index_bits(config), "way": range(config.merge_ways)})


def word_read(config: Config) -> data.StructLayout:
    """A word of a half's memory that is read if `valid`."""
    return data.StructLayout({"valid": 1, "slot": slot_layout(config)})


def arrived(config: Config) -> data.StructLayout:
    """The value of an entry, written to the slot in which it arrived."""
    return data.StructLayout(
        {"valid": 1, "slot": slot_layout(config), "value": layout(value_record(config))}
    )


def ranked(config: Config) -> data.StructLayout:
    """An entry to be appended to its run."""
    way = range(config.merge_ways)
    return data.StructLayout({"valid": 1, "way": way, "entry": layout(ranked_record(config))})


class Half(wiring.Component):
    """Half of the memory: the values of a job's entries by arrival, the keys by run and rank.

    **Timing**: one entry per cycle; two memories of `half_entries` words.
    """

    def __init__(self, config: Config):
        self.config = config
        self.counter = index_bits(config) + 1
        ports = {
            "arrived": In(arrived(config)),  # a value to be written
            "ranked": In(ranked(config)),  # an entry to be appended to its run
            "clear": In(1),  # all runs become empty
            # number of entries written, per run
            "written": Out(data.ArrayLayout(self.counter, config.merge_ways)),
            "head": In(word_read(config)),  # a word to be read
            "value": In(word_read(config)),  # a word to be read
            # the words read last, from a cycle later on
            "head_found": Out(layout(ranked_record(config))),
            "value_found": Out(layout(value_record(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        words = half_entries(self.config)
        heads = Memory(shape=layout(ranked_record(self.config)), depth=words, init=[])
        values = Memory(shape=layout(value_record(self.config)), depth=words, init=[])
        m.submodules.heads, m.submodules.values = heads, values
        write_head, write_value = heads.write_port(), values.write_port()
        for memory, asked, found in (
            (heads, self.head, self.head_found),
            (values, self.value, self.value_found),
        ):
            read = memory.read_port()
            m.d.comb += [read.en.eq(asked.valid), read.addr.eq(asked.slot), found.eq(read.data)]

        way, end = self.ranked.way, Signal(self.counter)
        m.d.comb += [
            end.eq(self.written[way]),
            write_head.en.eq(self.ranked.valid),
            write_head.addr.eq(Cat(end[:-1], way)),
            write_head.data.eq(self.ranked.entry),
            write_value.en.eq(self.arrived.valid),
            write_value.addr.eq(self.arrived.slot),
            write_value.data.eq(self.arrived.value),
        ]
        with m.If(write_head.en):
            m.d.sync += self.written[way].eq(end + 1)
        with m.If(self.clear):
            m.d.sync += self.written.eq(0)
        return m


def job(config: Config) -> data.StructLayout:
    """Layout of a job whose entries are all in a half or in sub-sorters.

    runs: number of its runs
    last: it is its group's last job
    """
    return data.StructLayout({"ready": 1, "runs": range(config.merge_ways + 1), "last": 1})


class Runs(wiring.Component):
    """Cuts jobs into batches, which the sub-sorters sort into runs.

    Jobs go to the halves in turn, batches to the sub-sorters in turn, so that the next job is
    formed while one is merged.

    **Timing**: one entry in per cycle while sub-sorters are free, and three cycles more per job. A
    cascade takes one entry per cycle; a sub-sorter of OR-trees is free again 3·entries + 2·phases
    cycles after it has begun, if at most two write to its half.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(stream_of(job_record(config))),
            "entries": In(stream_of(entry_record(config))),
            "arrived": Out(arrived(config)).array(HALVES),  # for each half
            "ranked": Out(ranked(config)).array(HALVES),  # for each half
            "jobs": Out(job(config)).array(HALVES),  # for each half
            # one bit per half: its job is over; its entries still being sorted are dropped
            "release": In(HALVES),
            "sorting": Out(1),  # a sub-sorter has entries
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        sorters = [Sorter(self.config) for _ in range(self.config.sub_sorters)]
        for k, sorter in enumerate(sorters):
            m.submodules[f"sorter{k}"] = sorter
            m.d.comb += sorter.release.eq(self.release)
        m.d.comb += self.sorting.eq(Cat(~sorter.idle for sorter in sorters).any())
        self._load(m, sorters)
        self._write(m, sorters)
        return m

    def _load(self, m: Module, sorters: list[Sorter]):
        """Store an entry's value in its slot, and pass its key to the current sub-sorter."""
        half, slot, turn = Signal(), Signal(slot_layout(self.config)), Signal(range(len(sorters)))
        push, last, entry = Signal(), Signal(), self.entries.payload
        free = Cat(sorter.i.ready for sorter in sorters).bit_select(turn, 1)
        self._cut(m, half, slot, free, push, last)
        with m.If(push & last):
            m.d.sync += turn.eq(Mux(turn == len(sorters) - 1, 0, turn + 1))
        for k, arrived in enumerate(self.arrived):
            m.d.comb += [arrived.valid.eq(push & (half == k)), arrived.slot.eq(slot)]
            m.d.comb += [arrived.value.splat.eq(entry.splat), arrived.value.mask.eq(entry.mask)]
        for k, sorter in enumerate(sorters):
            i = sorter.i.payload
            m.d.comb += [sorter.i.valid.eq(push & (turn == k)), i.entry.key.eq(entry.key)]
            m.d.comb += [i.entry.last.eq(last), i.to.way.eq(slot.way), i.to.half.eq(half)]

    def _cut(
        self, m: Module, half: Signal, slot: data.View, free: Value, push: Signal, last: Signal
    ):
        """Cut jobs into batches.

        half, slot: of the next entry
        free: the sub-sorter whose turn it is takes an entry
        push: an entry is stored
        last: of its batch
        """
        left, ends = Signal.like(self.i.payload.count), Signal()  # entries that are not in yet
        used, runs = Signal(HALVES), Signal(range(self.config.merge_ways + 1))
        m.d.comb += last.eq(slot.index.all() | (left == 1))
        m.d.sync += used.eq(used & ~self.release)
        with m.FSM() as fsm:
            with m.State("JOB"):
                m.d.comb += self.i.ready.eq(1)
                m.d.sync += [left.eq(self.i.payload.count), ends.eq(self.i.payload.last)]
                with m.If(self.i.valid):
                    m.next = "OPEN"
            with m.State("OPEN"):
                m.d.sync += [slot.eq(0), runs.eq(0)]
                with m.If(~used.bit_select(half, 1)):
                    m.d.sync += used.bit_select(half, 1).eq(1)
                    m.next = "LOAD"
                    with m.If(left == 0):
                        m.next = "CLOSE"
            with m.State("LOAD"):
                m.d.comb += self.entries.ready.eq(free)
                m.d.comb += push.eq(self.entries.valid & self.entries.ready)
                with m.If(push):
                    m.d.sync += [left.eq(left - 1), runs.eq(runs + last)]
                    m.d.sync += slot.as_value().eq(slot.as_value() + 1)
                    with m.If(left == 1):
                        m.next = "CLOSE"
            with m.State("CLOSE"):
                m.d.sync += half.eq(~half)
                m.next = "JOB"
        for k, job in enumerate(self.jobs):
            with m.If(fsm.ongoing("CLOSE") & (half == k)):
                m.d.sync += [job.ready.eq(1), job.runs.eq(runs), job.last.eq(ends)]
            with m.If(self.release[k]):
                m.d.sync += job.ready.eq(0)

    def _write(self, m: Module, sorters: list[Sorter]):
        """One sub-sorter at a time writes to a half; in each cycle another one has priority.

        A half takes as many entries as two sub-sorters output. If there are more, none may wait
        until the others have output all their entries: merging begins when each run has an entry.
        """
        count = len(sorters)
        first = Signal(count, init=1)
        if count > 2:
            m.d.sync += first.eq(first.rotate_left(1))
        ready = [Const(0, 1)] * count
        for number, ranked in enumerate(self.ranked):
            mine = [sorter.o.valid & (sorter.o.payload.to.half == number) for sorter in sorters]
            m.d.comb += ranked.valid.eq(any_of(mine))
            for k, sorter in enumerate(sorters):
                ahead, turns = Const(0, 1), [first[k]]
                for start in range(k - 1, k - count, -1):  # negative indices count from the end
                    ahead |= mine[start]
                    turns.append(first[start] & ~ahead)
                writes = mine[k] & any_of(turns)
                with m.If(writes):
                    m.d.comb += ranked.way.eq(sorter.o.payload.to.way)
                    m.d.comb += ranked.entry.eq(sorter.o.payload.entry)
                ready[k] |= writes
        m.d.comb += [sorter.o.ready.eq(bit) for sorter, bit in zip(sorters, ready, strict=True)]
