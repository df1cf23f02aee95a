"""Reads the table of groups, and hands each group's position and list to the parts behind."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Fork, Queue
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.fetch import unpacked
from splatcore.spec import convention, work
from splatcore.spec.axi import BEAT_ADDRESS_BITS, BURST_BEATS, DATA_BITS, read_record
from splatcore.spec.binning import group_record, groups_max
from splatcore.spec.config import Config
from splatcore.spec.raster import position_record, written_record
from splatcore.spec.record import Record

TAKERS = {"lists": 2, "positions": 8, "pixels": 8}
"""Streams of groups → depth of each one's queue: sorting runs ahead of rasterizing and writing."""


class Groups(wiring.Component):
    """Reads the table of groups and gives each group to all parts that handle it.

    Members
        start: a frame begins. width, height: of its image, pixels; groups_at: address of its
            table, in beats.
        lists: stream of `group_record` for sorting. positions: stream of `position_record` for
            rasterizing. These two have only the groups with entries. pixels: stream of
            `written_record` for writing.
        reads, data: to and from memory.

    **Timing**: a group a cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "start": In(1),
            "width": In(range(config.width_max + 1)),
            "height": In(range(config.height_max + 1)),
            "groups_at": In(BEAT_ADDRESS_BITS),
            "lists": Out(stream.Signature(layout(group_record()))),
            "positions": Out(stream.Signature(layout(position_record(config)))),
            "pixels": Out(stream.Signature(layout(written_record(config)))),
            "reads": Out(stream.Signature(layout(read_record()))),
            "data": In(stream.Signature(read_beat())),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        rows, columns = self._grid(m)
        slots = self._table(m, rows * columns)
        known = Record("known", {"group": group_record(), "position": position_record(self.config)})
        m.submodules.fork = fork = Fork(layout(known), len(TAKERS))
        row, column = Signal.like(rows), Signal.like(columns)
        group = fork.i.payload.group
        m.d.comb += [
            group.eq(slots.payload),
            fork.i.payload.position.row.eq(row),
            fork.i.payload.position.column.eq(column),
            fork.i.valid.eq(slots.valid),
            slots.ready.eq(fork.i.ready),
        ]
        last = column + 1 == columns
        with m.If(fork.i.valid & fork.i.ready):
            m.d.sync += [column.eq(Mux(last, 0, column + 1)), row.eq(row + last)]
        with m.If(self.start):
            m.d.sync += [column.eq(0), row.eq(0)]
        self._give(m, fork)
        return m

    def _grid(self, m: Module) -> tuple[Signal, Signal]:
        """Rows and columns of groups."""
        side = convention.TILE * self.config.group
        rows = Signal(range(self.config.height_max // side + 2))
        columns = Signal(range(self.config.width_max // side + 2))
        m.d.sync += rows.eq((self.height + side - 1) // side)
        m.d.sync += columns.eq((self.width + side - 1) // side)
        return rows, columns

    def _table(self, m: Module, count) -> stream.Interface:
        """The table's slots; it is asked for when the number of groups is known."""
        bits = groups_max(self.config).bit_length()
        fetch, unpack = unpacked(m, self, BURST_BEATS, bits, bits)
        groups, waits = Signal(bits), Signal(3)
        asks, counts = Signal(), Signal()
        m.d.sync += [groups.eq(count), waits.eq(Cat(self.start, waits))]
        a_beat = DATA_BITS // 8 // work.SLOT
        m.d.comb += [
            fetch.i.valid.eq(asks),
            fetch.i.payload.beat.eq(self.groups_at),
            fetch.i.payload.count.eq((groups + a_beat - 1) // a_beat),
            unpack.counts.valid.eq(counts),
            unpack.counts.payload.eq(groups),
        ]
        for wish, taken in ((asks, fetch.i.ready), (counts, unpack.counts.ready)):
            with m.If(waits[-1]):
                m.d.sync += wish.eq(1)
            with m.Elif(taken):
                m.d.sync += wish.eq(0)
        return unpack.o

    def _give(self, m: Module, fork: Fork):
        """Each group to each part, at the part's own pace."""
        for (name, depth), known in zip(TAKERS.items(), fork.o, strict=True):
            target = getattr(self, name)
            m.submodules[name] = queue = Queue(target.payload.shape(), depth)
            group, position = known.payload.group, known.payload.position
            empty = ~group.count.any()
            skipped = empty & (name != "pixels")
            m.d.comb += [
                queue.i.valid.eq(known.valid & ~skipped),
                known.ready.eq(queue.i.ready | skipped),
                queue.i.payload.eq(
                    {
                        "lists": group.as_value(),
                        "positions": position.as_value(),
                        "pixels": Cat(position, empty),
                    }[name]
                ),
            ]
            connect(m, queue.o, flipped(target))
