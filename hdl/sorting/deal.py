"""Front of stage 2: cuts groups' lists into jobs, long ones by way of buckets in scratch memory."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import enum, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Queue, passes
from splatcore.spec import sort
from splatcore.spec.binning import group_record
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, entry_record

JOBS_WAITING = 8  # jobs to be sorted; also lists ahead of the lists of the job being formed
JOBS_INSIDE = 16  # jobs that have been issued and are not over


class State(enum.Enum):
    """Step of processing a list."""

    LIST = 0  # the next list is examined; a short one is passed on
    BEGIN = 1  # a round begins as soon as an area is free
    DEAL = 2  # entries are dealt
    RANGE = 3  # minimum and maximum key are known
    FLUSH = 4  # a bucket is looked up,
    WRITE = 5  # and its last line written
    SETTLE = 6  # until all that was written is in memory
    LOOK = 7  # a bucket is looked up,
    COUNT = 8  # its entries are counted,
    GIVE = 9  # and issued; or the bucket is too full
    EDGE = 10  # minimum and maximum key of such a bucket are known
    EXTENT = 11  # distance from there to the maximum key of the round
    REST = 12  # the rest is issued
    NEXT = 13  # the round is over


class Deal(wiring.Component):
    """Turns lists into jobs, and into the lists of entries that belong to them (`spec.sort`).

    **Timing**: a list that fits on chip takes one cycle; a long one in each round one per entry, 5
    per bucket and the memory's latency, about, while earlier jobs are sorted. Memories: a count
    and a line per bucket. No multiplier.
    """

    def __init__(self, config: Config):
        self.config, self.half = config, sort.half_entries(config)
        entry, group = layout(entry_record(config)), layout(group_record())
        listed, job = layout(sort.listed_record()), layout(sort.job_record(config))
        ports = {
            "groups": In(stream.Signature(group)),  # `group_record`, lists with entries
            "reading": Out(stream.Signature(group)),  # `group_record`, lists to be read
            # `entry_record`, the entries of the list at `reading`
            "entries": In(stream.Signature(entry)),
            "lines": Out(stream_of(sort.line_record(config))),  # to be written to scratch memory
            "settled": In(1),  # all lines are in memory
            "jobs": Out(stream.Signature(job)),  # `job_record`
            # `listed_record`, lists whose entries are to be sorted, job by job
            "lists": Out(stream.Signature(listed)),
            "released": In(1),  # a job is over, and all its entries have been read
        }
        super().__init__(ports)
        key, shift = config.sort_key_bits, range(sort.shift_max(config) + 1)
        self.jobs_waiting = Queue(job, JOBS_WAITING)
        self.lists_waiting = Queue(listed, sort.BUCKETS + JOBS_WAITING, memory=True)
        self.state, self.area = Signal(State), Signal(range(sort.AREAS))
        self.base, self.shift = Signal(key), Signal(shift)
        # For the next list.
        self.next_base, self.next_shift = Signal(key), Signal(shift, init=sort.shift_max(config))
        # Entries that have been issued: keys below `low`, and `skip` entries with key `low`.
        self.low, self.skip = Signal(key), Signal(COUNT_BITS)
        self.least, self.greatest = Signal(key), Signal(key)  # keys of the round
        self.high, self.extent = Signal(key), Signal(key)
        self.left, self.rest = Signal(COUNT_BITS), Signal(COUNT_BITS)  # to be issued; to come
        self.more = Signal()  # any are to come
        self.bucket, self.looked_up = Signal(sort.BUCKET_BITS), Signal(sort.BUCKET_BITS)
        self.held, self.full = Signal(entry, reset_less=True), Signal()  # the entry being dealt
        self.before = Signal(entry, reset_less=True)  # the entry dealt before it
        # It went to the same bucket while that was looked up; the next entry may follow.
        self.again, self.moves = Signal(), Signal()
        self.count = Signal(range(self.half + 2))  # of the bucket looked up
        self.through, self.keep, self.ignored = Signal(), Signal(), Signal()  # the entry held
        self.counted = Signal.like(self.count)  # the same, with the entry dealt, a cycle later
        self.total = Signal(range(self.half + 1))  # of the buckets of the next job
        self.ends_round, self.all_used, self.job_room = Signal(), Signal(), Signal()
        self.over, self.equal = Signal(), Signal()  # a bucket is too full; all its keys are equal

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.jobs, m.submodules.lists = self.jobs_waiting, self.lists_waiting
        connect(m, self.jobs_waiting.o, flipped(self).jobs)
        connect(m, self.lists_waiting.o, flipped(self).lists)
        m.d.comb += self.reading.payload.eq(self.groups.payload)
        self._entry(m)
        self._lines(m, self._memories(m))
        self._keys(m)
        self._areas(m)
        self._control(m)
        return m

    def _entry(self, m: Module):
        """Look an entry up when it comes, and write it a cycle later."""
        entries, dealing = self.entries, self.state == State.DEAL
        key, seen = self.held.key, Signal(COUNT_BITS)
        of_low = Signal()  # it was issued before, though its key is not below `low`
        m.d.comb += [
            self.moves.eq(~self.full | self.through),
            entries.ready.eq(dealing & self.moves & self.more),
            of_low.eq((key == self.low) & (seen != self.skip)),
            self.ignored.eq((key < self.low) | of_low),
            self.keep.eq(~self.ignored & (self.count < self.half)),
        ]
        with m.If(self.moves):
            m.d.sync += [self.full.eq(passes(entries)), self.held.eq(entries.payload)]
            m.d.sync += [self.before.eq(self.held), seen.eq(seen + (of_low & self.through))]
        with m.If(passes(entries)):  # `more` not by `rest` itself: a ripple of 24
            m.d.sync += [self.rest.eq(self.rest - 1), self.more.eq(self.rest[1:].any())]
        with m.If(self.state == State.BEGIN):
            m.d.sync += [seen.eq(0), self.rest.eq(self.groups.payload.count), self.more.eq(1)]

    def _memories(self, m: Module) -> list[Value]:
        """Counts and begun line of each bucket; return the entries of the line."""
        dealing, key = self.state == State.DEAL, self.entries.payload.key
        bucket, present = Signal(sort.BUCKET_BITS), Signal(sort.BUCKETS)
        offset = key - self.base
        steps = offset[:-1] >> self.shift
        within = Mux(steps[sort.BUCKET_BITS :].any(), sort.BUCKETS - 1, steps[: sort.BUCKET_BITS])
        m.d.comb += bucket.eq(Mux(dealing, Mux(offset[-1], 0, within), self.bucket))
        written, at = Signal(), Signal.like(self.looked_up)  # the entry dealt before, its bucket
        m.d.comb += self.again.eq(self.full & written & (self.looked_up == at))
        m.submodules.counts = counts = Memory(shape=self.count.shape(), depth=sort.BUCKETS, init=[])
        write, read = counts.write_port(), counts.read_port()
        ports, found = [write, read], []
        found_count = Mux(present.bit_select(self.looked_up, 1), read.data, 0)
        m.d.comb += [
            self.count.eq(Mux(self.again, self.counted, found_count)),
            write.data.eq(self.count + 1),
            write.en.eq(self.through & ~self.ignored & (self.count <= self.half)),
        ]
        with m.If(self.moves):
            m.d.sync += [self.looked_up.eq(bucket), self.counted.eq(self.count + self.full)]
            m.d.sync += [at.eq(self.looked_up), written.eq(write.en)]
        place = self.count[: exact_log2(sort.LINE_SLOTS)]
        for k in range(sort.LINE_SLOTS - 1):
            memory = Memory(shape=len(self.held.as_value()), depth=sort.BUCKETS, init=[])
            m.submodules[f"slot{k}"] = memory
            write, read = memory.write_port(), memory.read_port()
            m.d.comb += write.data.eq(self.held)
            m.d.comb += write.en.eq(self.through & self.keep & (place == k))
            found, ports = [*found, read.data], [*ports, write, read]
        for write, read in zip(ports[::2], ports[1::2], strict=True):
            m.d.comb += [read.addr.eq(bucket), read.en.eq(self.moves)]
            m.d.comb += write.addr.eq(self.looked_up)
        with m.If(self.state == State.BEGIN):
            m.d.sync += present.eq(0)
        with m.Elif(self.through & ~self.ignored):
            m.d.sync += present.bit_select(self.looked_up, 1).eq(1)
        return found

    def _lines(self, m: Module, slots: list[Value]):
        """Write a bucket's line with its last entry, or when the round ends."""
        bits = exact_log2(sort.LINE_SLOTS)
        lines, place, ending = self.lines, self.count[:bits], self.state == State.WRITE
        last = self.full & self.keep & place.all()
        begun = place.any() & (self.count < self.half)
        number = self.count[bits : exact_log2(self.half)]
        m.d.comb += [
            lines.valid.eq(last | (ending & begun)),
            lines.payload.address.eq(Cat(number, self.looked_up, self.area)),
            lines.payload.slots[-1].eq(Mux(ending, 0, self.held.as_value())),
            self.through.eq(self.full & (~last | lines.ready)),
        ]
        slots[-1] = Mux(self.again, self.before, slots[-1])  # maybe written when it was looked up
        for k, slot in enumerate(slots):
            m.d.comb += lines.payload.slots[k].eq(Mux(ending & (place <= k), 0, slot))

    def _keys(self, m: Module):
        """Minimum and maximum key of a round; base and shift for the next list."""
        key, state, first = self.held.key, self.state, Signal()
        shift = Signal.like(self.shift)
        for bit in range(len(self.extent)):
            with m.If(self.extent[bit]):
                m.d.comb += shift.eq(sort.bucket_shift(1 << bit))
        with m.If(state == State.BEGIN):
            m.d.sync += [self.least.eq(~0), self.greatest.eq(0)]
        with m.Elif(self.through & ~self.ignored):
            with m.If(key < self.least):
                m.d.sync += self.least.eq(key)
            with m.If(key > self.greatest):
                m.d.sync += self.greatest.eq(key)
        with m.Switch(state):
            with m.Case(State.LIST):
                m.d.sync += [self.base.eq(self.next_base), self.shift.eq(self.next_shift)]
                m.d.sync += [self.low.eq(0), self.skip.eq(0), first.eq(1)]
            with m.Case(State.RANGE):
                m.d.sync += self.extent.eq(self.greatest - self.least)
            with m.Case(State.SETTLE), m.If(first):
                m.d.sync += [self.next_base.eq(self.least), self.next_shift.eq(shift)]
            with m.Case(State.EDGE):
                low, high = Signal.like(self.low), Signal.like(self.high)
                begin = self.base + (self.bucket << self.shift)
                end = self.base + ((self.bucket + 1) << self.shift) - 1
                m.d.comb += [low.eq(self.least), high.eq(self.greatest)]
                with m.If(self.bucket.any() & (begin > self.least)):
                    m.d.comb += low.eq(begin)
                with m.If(~self.bucket.all() & (end < self.greatest)):
                    m.d.comb += high.eq(end)
                m.d.sync += [self.low.eq(low), self.high.eq(high), first.eq(0)]
                with m.If(low != self.low):
                    m.d.sync += self.skip.eq(0)
            with m.Case(State.EXTENT):
                m.d.sync += self.extent.eq(self.greatest - self.low)
                m.d.sync += self.equal.eq(self.high == self.low)
            with m.Case(State.NEXT):
                narrower = Mux(self.shift < sort.NARROWER, 0, self.shift - sort.NARROWER)
                wanted = Mux(self.bucket.all(), self.shift + 1, narrower)
                m.d.sync += self.base.eq(self.low)
                m.d.sync += self.shift.eq(Mux(wanted < shift, wanted, shift))

    def _areas(self, m: Module):
        """An area is in use from its first job until its last job is over."""
        m.submodules.inside = self.inside = Queue(1, JOBS_INSIDE)  # per job: it ends a round
        m.submodules.used = used = Credit(sort.AREAS, "areas in use")
        job, inside, begins = self.jobs_waiting.i, self.inside, Signal()
        m.d.comb += [
            inside.i.valid.eq(job.valid),
            inside.i.payload.eq(self.ends_round),
            inside.o.ready.eq(self.released),
            begins.eq(inside.i.valid & self.ends_round),
            used.comes.eq(begins),
            used.goes.eq(self.released & inside.o.valid & inside.o.payload),
            self.all_used.eq(~used.room),
            self.job_room.eq(job.ready & inside.i.ready),
        ]
        for name, queue in (("jobs", job), ("lists", self.lists_waiting.i), ("inside", inside.i)):
            never_waits(m, name, queue, f"an item of {name}")
        with m.If(begins):
            m.d.sync += self.area.eq(Mux(self.area == sort.AREAS - 1, 0, self.area + 1))

    def _control(self, m: Module):
        """Process list after list; rounds for a long list."""
        state, group = self.state, self.groups.payload
        short = group.count <= self.half
        with m.Switch(state):
            with m.Case(State.LIST):
                m.d.sync += [self.left.eq(group.count), self.total.eq(0)]
                with m.If(self.groups.valid & ~short):
                    m.d.sync += state.eq(State.BEGIN)
                with m.Elif(self.groups.valid & self.lists_waiting.i.ready & self.job_room):
                    m.d.comb += self.groups.ready.eq(1)
                    self._give_list(m, group.page, group.count, 0)
                    self._give_job(m, group.count, 1, 0)
            with m.Case(State.BEGIN):
                m.d.comb += self.reading.valid.eq(~self.all_used)
                m.d.sync += self.bucket.eq(0)
                with m.If(self.reading.valid & self.reading.ready):
                    m.d.sync += state.eq(State.DEAL)
            with m.Case(State.DEAL), m.If(~self.more & ~self.full):
                m.d.sync += state.eq(State.RANGE)
            with m.Case(State.WRITE), m.If(~self.lines.valid | self.lines.ready):
                m.d.sync += self.bucket.eq(self.bucket + 1)
                m.d.sync += state.eq(Mux(self.bucket.all(), State.SETTLE, State.FLUSH))
            with m.Case(State.SETTLE), m.If(self.settled):
                m.d.sync += state.eq(State.LOOK)
            with m.Case(State.GIVE):
                self._give(m)
            with m.Case(State.REST):
                self._give_rest(m)
            for name in "RANGE FLUSH LOOK COUNT EDGE EXTENT".split():
                with m.Case(State[name]):
                    m.d.sync += state.eq(State[name].value + 1)
            with m.Case(State.NEXT):
                m.d.comb += self.groups.ready.eq(~self.left.any())
                m.d.sync += state.eq(Mux(self.left.any(), State.BEGIN, State.LIST))

    def _give(self, m: Module):
        """Add a bucket to the next job, if there is room."""
        count = self.counted
        room = (self.total + count <= self.half) & (self.total < sort.full_enough(self.config))
        fits = room | ~count.any()
        with m.If(count > self.half):
            m.d.sync += [self.over.eq(1), self.state.eq(State.EDGE)]
        with m.Elif(~fits), m.If(self.job_room):
            self._give_job(m, self.total, 0, 0)
        with m.Elif(~count.any() | self.lists_waiting.i.ready):
            with m.If(count.any()):
                self._give_list(m, self._place(), count, 1)
            m.d.sync += [self.total.eq(self.total + count), self.left.eq(self.left - count)]
            m.d.sync += self.bucket.eq(self.bucket + 1)
            m.d.sync += self.state.eq(Mux(self.bucket.all(), State.REST, State.LOOK))

    def _give_rest(self, m: Module):
        """Issue the round's last job; then, if keys are equal, part of a bucket too full."""
        equal, part = self.over & self.equal, Signal()
        with m.If(self.total.any()), m.If(self.job_room):
            self._give_job(m, self.total, ~self.left.any(), ~equal | part)
        with m.Elif(equal & ~part), m.If(self.lists_waiting.i.ready):
            self._give_list(m, self._place(), self.half, 1)
            m.d.sync += [self.total.eq(self.half), self.left.eq(self.left - self.half)]
            m.d.sync += [self.skip.eq(self.skip + self.half), part.eq(1)]
        with m.Else():
            m.d.sync += [part.eq(0), self.over.eq(0), self.state.eq(State.NEXT)]

    def _place(self) -> Value:
        """A bucket's place in scratch memory, as field `page` of a list."""
        return Cat(self.looked_up, self.area)

    def _give_list(self, m: Module, page: Value, count: Value, dealt: int):
        to = self.lists_waiting.i
        m.d.comb += [to.valid.eq(1), to.payload.page.eq(page), to.payload.count.eq(count)]
        m.d.comb += to.payload.dealt.eq(dealt)

    def _give_job(self, m: Module, count: Value, last: Value, ends: Value):
        to = self.jobs_waiting.i
        m.d.comb += [to.valid.eq(1), to.payload.count.eq(count), to.payload.last.eq(last)]
        m.d.comb += self.ends_round.eq(ends)
        m.d.sync += self.total.eq(0)
