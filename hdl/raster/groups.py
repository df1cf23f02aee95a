"""Reads the table of groups, and passes each group's position and list to the parts behind."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.holds import never_waits
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Fork, Queue, Register
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.fetch import Fetch, Unpack
from splatcore.hdl.memory.share import Share
from splatcore.hdl.raster.job import job_layout
from splatcore.spec import convention, work
from splatcore.spec.axi import BURST_BEATS, DATA_BITS, port_beats, read_record
from splatcore.spec.binning import group_record, groups_max
from splatcore.spec.config import Config
from splatcore.spec.raster import position_record
from splatcore.spec.record import Record

TAKERS = {"lists": 2, "positions": 8, "pixels": 8}
"""Streams of groups → depth of their queues: sorting runs ahead of rasterizing and writing."""

EMPTY_WAITING = 2  # groups without entries that wait to be written


class Walk(wiring.Component):
    """A walk through the groups of an image, row after row.

    **Timing**: one group per cycle.
    """

    def __init__(self, config: Config):
        side = convention.TILE * config.group
        ports = {
            "start": In(1),  # go to the first group
            "rows": In(range(config.side_max // side + 2)),  # of the image, in groups
            "columns": In(range(config.side_max // side + 2)),  # of the image, in groups
            "step": In(1),  # go to the next group
            "position": Out(layout(position_record(config))),  # of the present group
            "active": Out(1),  # `position` is valid: the last group is not yet past
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        row, column = self.position.row, self.position.column
        ends = column + 1 == self.columns
        with m.If(self.start):
            m.d.sync += [column.eq(0), row.eq(0), self.active.eq(1)]
        with m.Elif(self.step):
            m.d.sync += [column.eq(Mux(ends, 0, column + 1)), row.eq(row + ends)]
            m.d.sync += self.active.eq(~(ends & (row + 1 == self.rows)))
        return m


class Groups(wiring.Component):
    """Reads the table of groups, and passes each group to all parts that handle it.

    There are two walks: one passes on the groups with entries as fast as they are taken; the other
    finds the groups without entries, far ahead of the first.

    **Timing**: one group with entries per cycle; the other walk takes 4 cycles and memory's latency
    per group. One multiplier, for `groups`.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "start": In(1),  # a frame begins
            "job": In(job_layout(config)),
            "lists": Out(stream_of(group_record())),  # groups with entries, for sorting
            # groups with entries, for rasterizing and for writing pixels; groups without entries
            "positions": Out(stream_of(position_record(config))),
            "pixels": Out(stream_of(position_record(config))),
            "empty": Out(stream_of(position_record(config))),
            # number of groups of the image, valid a few cycles after `start`
            "groups": Out(range(groups_max(config) + 1)),
            "busy": Out(1),  # groups of the image are still to be visited, or in flight
            "reads": Out(stream_of(read_record())),  # to memory
            "data": In(stream.Signature(read_beat(config))),  # from memory
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.share = share = Share(self.config)
        connect(m, share.reads, flipped(self.reads))
        connect(m, flipped(self.data), share.data)
        known = self._grid(m)
        self._give(m, self._table(m, known, share))
        self._find_empty(m, known, share)
        return m

    def _grid(self, m: Module) -> Value:
        """The two walks and the number of groups; return whether the number is valid now."""
        side = convention.TILE * self.config.group
        self.walk, self.search = Walk(self.config), Walk(self.config)
        m.submodules.walk, m.submodules.search = self.walk, self.search
        rows, columns = Signal.like(self.walk.rows), Signal.like(self.walk.columns)
        m.d.sync += rows.eq((self.job.height + side - 1) // side)
        m.d.sync += columns.eq((self.job.width + side - 1) // side)
        m.d.sync += self.groups.eq(rows * columns)
        waits = Signal(3)
        m.d.sync += waits.eq(Cat(self.start, waits))
        known = waits[-1]
        for walk in (self.walk, self.search):
            m.d.comb += [walk.start.eq(known), walk.rows.eq(rows), walk.columns.eq(columns)]
        m.d.comb += self.busy.eq(self.walk.active | self.search.active)
        return known

    def _table(self, m: Module, known: Value, share: Share) -> stream.Interface:
        """The table's slots; requested when the number of groups is known."""
        bits = len(self.groups)
        m.submodules.fetch = fetch = Fetch(self.config, BURST_BEATS, bits)
        m.submodules.unpack = unpack = Unpack(self.config, bits, ranges=1)
        connect(m, fetch.reads, share.i[0])
        connect(m, share.o[0], fetch.data)
        connect(m, fetch.o, unpack.beats)
        a_beat = DATA_BITS // 8 // work.SLOT
        m.d.comb += [  # both are free, as the last frame has ended
            fetch.i.valid.eq(known),
            fetch.i.payload.beat.eq(self.job.area.groups),
            fetch.i.payload.count.eq((self.groups + a_beat - 1) // a_beat),
            unpack.counts.valid.eq(known),
            unpack.counts.payload.eq(self.groups),
        ]
        for name, taker in (("table", fetch.i), ("counts", unpack.counts)):
            never_waits(m, name, taker, "the table of groups")
        return unpack.o

    def _give(self, m: Module, slots: stream.Interface):
        """Pass each group with entries to each part, at the part's own pace."""
        known = Record("known", {"group": group_record(), "position": position_record(self.config)})
        m.submodules.fork = fork = Fork(layout(known), len(TAKERS))
        i, group = fork.i, fork.i.payload.group
        given = group.count.any()
        m.d.comb += [
            group.eq(slots.payload),
            i.payload.position.eq(self.walk.position),
            i.valid.eq(slots.valid & given),
            slots.ready.eq(i.ready | ~given),
            self.walk.step.eq(slots.valid & slots.ready),
        ]
        for (name, depth), o in zip(TAKERS.items(), fork.o, strict=True):
            queued = self._queued(m, name, depth)
            group, position = o.payload.group, o.payload.position
            payload = group if name == "lists" else position
            m.d.comb += [queued.valid.eq(o.valid), o.ready.eq(queued.ready)]
            m.d.comb += queued.payload.eq(payload)

    def _queued(self, m: Module, name: str, depth: int) -> stream.Interface:
        """Connect a queue and a register to the named output; return the queue's input."""
        target = getattr(self, name)
        m.submodules[name] = queue = Queue(target.payload.shape(), depth)
        m.submodules[f"{name}_next"] = following = Register(target.payload.shape())
        connect(m, queue.o, following.i)
        connect(m, following.o, flipped(target))
        return queue.i

    def _find_empty(self, m: Module, known: Value, share: Share):
        """Look up one group after the other while there is room for one without entries."""
        walk, asks, beat = self.search, share.i[1], share.o[1]
        queued = self._queued(m, "empty", EMPTY_WAITING)
        asked = Signal()  # the present group's beat is in flight
        number = Signal.like(self.groups)
        slots = self.config.port // 8 // work.SLOT
        low = exact_log2(slots)
        group = Signal(layout(group_record()))
        m.d.comb += [
            asks.valid.eq(walk.active & ~asked & queued.ready),
            asks.payload.beat.eq(self.job.area.groups + number[low:] * port_beats(self.config)),
            asks.payload.length.eq(0),
            beat.ready.eq(1),
            group.eq(beat.payload.beat.word_select(number[:low], self.config.port // slots)),
            queued.valid.eq(beat.valid & ~group.count.any()),
            queued.payload.eq(walk.position),
            walk.step.eq(beat.valid),
        ]
        with m.If(known):
            m.d.sync += number.eq(0)
        with m.Elif(beat.valid):
            m.d.sync += [asked.eq(0), number.eq(number + 1)]
        with m.Elif(asks.valid & asks.ready):
            m.d.sync += asked.eq(1)
