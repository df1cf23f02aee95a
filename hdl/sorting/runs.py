"""Stage 2's memory, and its front: batches of entries become runs in it."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.sorting.subsort import SubSorter, any_of
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, entry_record
from splatcore.spec.record import Record
from splatcore.spec.sort import count_record, half_entries, index_bits, ranked_record

HALVES = 2


def value_record(config: Config) -> Record:
    """What of an entry is not looked at by sorting."""
    entry = entry_record(config)
    return Record("value", {field: entry[field] for field in ("splat", "mask")})


def place(config: Config) -> data.StructLayout:
    """A word of a half's memories: a way's, or run's, part and a place in it."""
    return data.StructLayout({"index": index_bits(config), "way": range(config.merge_ways)})


def arrived(config: Config) -> data.StructLayout:
    """A value that is written where its entry arrived."""
    return data.StructLayout(
        {"now": 1, "place": place(config), "value": layout(value_record(config))}
    )


def ranked(config: Config) -> data.StructLayout:
    """An entry behind the others of its run."""
    way = range(config.merge_ways)
    return data.StructLayout({"now": 1, "way": way, "entry": layout(ranked_record(config))})


def returned(config: Config) -> data.StructLayout:
    """An entry from scratch memory behind the others of its run."""
    way, entry = range(config.merge_ways), layout(entry_record(config))
    return data.StructLayout({"now": 1, "way": way, "last": 1, "entry": entry})


class Half(wiring.Component):
    """Half of the memory: the values of a job's entries by arrival, the keys by run and rank.

    Members
        arrived, ranked: what is written of a job; returned: of a merge from scratch memory, to
            both memories, a way's part being a ring.
        clear: no run has an entry.
        written: how many entries each run has got, modulo twice the room of a way.
        head, value: words to be read; head_found, value_found: the answers a cycle later.

    **Timing**: an entry a cycle; two memories of `half_entries` words.
    """

    def __init__(self, config: Config):
        self.config = config
        self.counter = index_bits(config) + 1
        super().__init__(
            {
                "arrived": In(arrived(config)),
                "ranked": In(ranked(config)),
                "returned": In(returned(config)),
                "clear": In(1),
                "written": Out(data.ArrayLayout(self.counter, config.merge_ways)),
                "head": In(place(config)),
                "value": In(place(config)),
                "head_found": Out(layout(ranked_record(config))),
                "value_found": Out(layout(value_record(config))),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        words = half_entries(self.config)
        heads = Memory(shape=layout(ranked_record(self.config)), depth=words, init=[])
        values = Memory(shape=layout(value_record(self.config)), depth=words, init=[])
        m.submodules.heads, m.submodules.values = heads, values
        put_head, put_value = heads.write_port(), values.write_port()
        for memory, asked, found in (
            (heads, self.head, self.head_found),
            (values, self.value, self.value_found),
        ):
            read = memory.read_port()
            m.d.comb += [read.en.eq(1), read.addr.eq(asked), found.eq(read.data)]

        back, way, end = self.returned, Signal.like(self.ranked.way), Signal(self.counter)
        m.d.comb += [
            way.eq(Mux(back.now, back.way, self.ranked.way)),
            end.eq(self.written[way]),
            put_head.en.eq(self.ranked.now | back.now),
            put_head.addr.eq(Cat(end[:-1], way)),
            put_head.data.eq(self.ranked.entry),
            put_value.en.eq(self.arrived.now | back.now),
            put_value.addr.eq(self.arrived.place),
            put_value.data.eq(self.arrived.value),
        ]
        with m.If(back.now):
            m.d.comb += [
                put_head.data.key.eq(back.entry.key),
                put_head.data.index.eq(end),
                put_head.data.last.eq(back.last),
                put_value.addr.eq(put_head.addr),
                put_value.data.splat.eq(back.entry.splat),
                put_value.data.mask.eq(back.entry.mask),
            ]
        with m.If(put_head.en):
            m.d.sync += self.written[way].eq(end + 1)
        with m.If(self.clear):
            m.d.sync += self.written.eq(0)
        return m


def job(config: Config) -> data.StructLayout:
    """A job whose entries are all in a half or in sub-sorters.

    runs: how many it has; long: its group has several jobs; last: it is its group's last one.
    """
    return data.StructLayout(
        {"ready": 1, "runs": range(config.merge_ways + 1), "long": 1, "last": 1}
    )


class Runs(wiring.Component):
    """Cuts groups into jobs, jobs into batches, and lets the sub-sorters make runs of these.

    Jobs go to the halves in turn, batches to the sub-sorters in turn, so the next job is being
    formed while one is merged.

    Members
        groups: stream of `count_record`; entries: stream of `entry_record`.
        arrived, ranked: what is written in each half.
        jobs: the job of each half.
        release: a half's job is over: what is still being sorted of it is dropped.
        sorting: a sub-sorter has entries.

    **Timing**: an entry in per cycle while sub-sorters are free, 3 cycles more for a job; a
    sub-sorter is free again 3·entries + 2·phases cycles after it has begun, if no more than two
    write to its half.
    """

    def __init__(self, config: Config):
        self.config = config
        super().__init__(
            {
                "groups": In(stream.Signature(layout(count_record()))),
                "entries": In(stream.Signature(layout(entry_record(config)))),
                "arrived": Out(arrived(config)).array(HALVES),
                "ranked": Out(ranked(config)).array(HALVES),
                "jobs": Out(job(config)).array(HALVES),
                "release": In(HALVES),
                "sorting": Out(1),
            }
        )

    def elaborate(self, platform) -> Module:
        m = Module()
        sorters = [SubSorter(self.config) for _ in range(self.config.sub_sorters)]
        # Where the run goes that a sub-sorter makes.
        owners = [Signal(place(self.config), name=f"owner{k}") for k in range(len(sorters))]
        halves = [Signal(name=f"half{k}") for k in range(len(sorters))]
        for k, sorter in enumerate(sorters):
            m.submodules[f"sorter{k}"] = sorter
            # A drop is not for one that was idle: it may just be getting an entry of the next job.
            m.d.comb += sorter.drop.eq(self.release.bit_select(halves[k], 1) & ~sorter.idle)
        m.d.comb += self.sorting.eq(Cat(~sorter.idle for sorter in sorters).any())
        self._load(m, sorters, owners, halves)
        self._write(m, sorters, owners, halves)
        return m

    def _load(self, m: Module, sorters: list, owners: list, halves: list):
        """An entry's value goes to its place, its key to the sub-sorter whose turn it is."""
        half, to, turn = Signal(), Signal(place(self.config)), Signal(range(len(sorters)))
        put, last, entry = Signal(), Signal(), self.entries.payload
        # What is still offered by a sub-sorter goes where its owner says.
        free = Cat(sorter.i.ready & ~sorter.o.valid for sorter in sorters).bit_select(turn, 1)
        self._cut(m, half, to, free, put, last)
        with m.If(put & last):
            m.d.sync += turn.eq(Mux(turn == len(sorters) - 1, 0, turn + 1))
        for k, arrived in enumerate(self.arrived):
            m.d.comb += [
                arrived.now.eq(put & (half == k)),
                arrived.place.eq(to),
                arrived.value.splat.eq(entry.splat),
                arrived.value.mask.eq(entry.mask),
            ]
        for k, sorter in enumerate(sorters):
            mine = put & (turn == k)
            m.d.comb += [
                sorter.i.valid.eq(mine),
                sorter.i.payload.key.eq(entry.key),
                sorter.i.payload.last.eq(last),
            ]
            with m.If(mine):
                m.d.sync += [owners[k].eq(to), halves[k].eq(half)]

    def _cut(self, m: Module, half: Signal, to: data.View, free: Value, put: Signal, last: Signal):
        """Groups into jobs, jobs into batches.

        half, to: where the next entry goes; put: it does, if a sub-sorter is free; last: of its
        batch.
        """
        left, long = Signal(COUNT_BITS), Signal()  # entries of the group that are not in yet
        used, runs = Signal(HALVES), Signal(range(self.config.merge_ways + 1))
        m.d.comb += last.eq(to.index.all() | (left == 1))
        m.d.sync += used.eq(used & ~self.release)
        with m.FSM() as fsm:
            with m.State("GROUP"):
                m.d.comb += self.groups.ready.eq(1)
                m.d.sync += [
                    left.eq(self.groups.payload.count),
                    long.eq(self.groups.payload.count > half_entries(self.config)),
                ]
                with m.If(self.groups.valid):
                    m.next = "OPEN"
            with m.State("OPEN"):
                m.d.sync += [to.eq(0), runs.eq(0)]
                with m.If(~used.bit_select(half, 1)):
                    m.d.sync += used.bit_select(half, 1).eq(1)
                    m.next = "LOAD"
                    with m.If(left == 0):
                        m.next = "CLOSE"
            with m.State("LOAD"):
                m.d.comb += [
                    self.entries.ready.eq(free),
                    put.eq(self.entries.valid & self.entries.ready),
                ]
                with m.If(put):
                    m.d.sync += [left.eq(left - 1), runs.eq(runs + last)]
                    m.d.sync += to.as_value().eq(to.as_value() + 1)
                    with m.If((left == 1) | to.as_value().all()):
                        m.next = "CLOSE"
            with m.State("CLOSE"):
                m.d.sync += half.eq(~half)
                m.next = "OPEN"
                with m.If(left == 0):
                    m.next = "GROUP"
        for k, job in enumerate(self.jobs):
            with m.If(fsm.ongoing("CLOSE") & (half == k)):
                m.d.sync += [job.ready.eq(1), job.runs.eq(runs), job.long.eq(long)]
                m.d.sync += job.last.eq(left == 0)
            with m.If(self.release[k]):
                m.d.sync += job.ready.eq(0)

    def _write(self, m: Module, sorters: list, owners: list, halves: list):
        """One sub-sorter at a time writes to a half, in each cycle another one before all others.

        A half takes what two give. Of more, none may wait until the others have given all that they
        have: merging begins when each run has an entry.
        """
        count = len(sorters)
        first = Signal(count, init=1)
        if count > 2:
            m.d.sync += first.eq(first.rotate_left(1))
        ready = [Const(0, 1)] * count
        for number, ranked in enumerate(self.ranked):
            mine = [sorter.o.valid & (halves[k] == number) for k, sorter in enumerate(sorters)]
            m.d.comb += ranked.now.eq(any_of(mine))
            for k, sorter in enumerate(sorters):
                ahead, turns = Const(0, 1), [first[k]]
                for start in range(k - 1, k - count, -1):  # negative ones count from the end
                    ahead |= mine[start]
                    turns.append(first[start] & ~ahead)
                writes = mine[k] & any_of(turns)
                with m.If(writes):
                    m.d.comb += [ranked.way.eq(owners[k].way), ranked.entry.eq(sorter.o.payload)]
                ready[k] |= writes
        m.d.comb += [sorter.o.ready.eq(now) for sorter, now in zip(sorters, ready, strict=True)]
