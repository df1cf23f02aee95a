"""Binning, third step: collects a splat's rows of tiles by group, each with a mask."""

from amaranth.hdl import Cat, Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.binning.rows import columns_layout
from splatcore.spec.config import Config
from splatcore.spec.group import group_grid


def part_layout(config: Config) -> data.StructLayout:
    """A splat's tiles in a group; the mask may be empty if the part is a splat's last one."""
    most, _ = group_grid(config, config.side_max, config.side_max)
    return data.StructLayout(
        {"row": range(most), "column": range(most), "mask": config.group**2, "last": 1}
    )


class Gather(wiring.Component):
    """Turns rows of tiles into parts of splats, one per group.

    Rows of tiles in the same row of groups wait until all have come; then the groups are visited
    column by column, while the next rows come in.

    **Timing**: one row and one group per cycle; latency 1 from the row that completes a row of
    groups. No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        self.bits = config.group.bit_length() - 1
        if config.group != 1 << self.bits:
            raise ValueError(f"{config.name}: group {config.group} is no power of two")
        ports = {
            "i": In(stream.Signature(columns_layout(config))),
            "o": Out(stream.Signature(part_layout(config))),
            "busy": Out(1),  # rows of a splat are inside
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        row, bits, count = self.i.payload, self.bits, self.config.group
        interval = data.StructLayout({name: row[name].shape() for name in ("begin", "end")})
        none = {"begin": 1, "end": 0}
        waiting = Signal(data.ArrayLayout(interval, count), init=[none] * count)
        merged = Signal.like(waiting)
        begin, end = row.begin >> bits, row.end >> bits
        some, least, most = Signal(), Signal.like(begin), Signal.like(end)
        found, first, last = Signal(), Signal.like(begin), Signal.like(end)
        tiles = row.begin <= row.end
        m.d.comb += found.eq(some | tiles)
        m.d.comb += first.eq(Mux(tiles & (~some | (begin < least)), begin, least))
        m.d.comb += last.eq(Mux(tiles & (~some | (end > most)), end, most))
        slot = row.row[:bits] if bits else 0
        for k in range(count):
            m.d.comb += merged[k].eq(Mux(slot == k, Cat(row.begin, row.end), waiting[k]))

        complete = row.last | (slot == count - 1)
        free, take = Signal(), Signal()
        m.d.comb += self.i.ready.eq(~complete | ~(found | row.last) | free)
        m.d.comb += take.eq(self.i.valid & self.i.ready)
        with m.If(take & complete):
            m.d.sync += [waiting[k].eq(interval.const(none)) for k in range(count)]
            m.d.sync += some.eq(0)
        with m.Elif(take):
            m.d.sync += [waiting.eq(merged), some.eq(found), least.eq(first), most.eq(last)]
        self._parts(m, merged, take & complete & (found | row.last), free, found, first, last)
        m.d.comb += self.busy.eq(some | self.o.valid | self.i.valid)
        return m

    def _parts(self, m: Module, merged, load: Value, free: Signal, found, first, last):
        """Hold a complete row of groups, and output its groups column by column."""
        row, part = self.i.payload, self.o.payload
        valid, ends = Signal(), Signal()
        rows, most = Signal.like(merged), Signal.like(part.column)
        at_end = part.column == most
        column = Signal.like(part.column)
        shown = part.mask.any() | (at_end & ends)
        leaves = valid & (self.o.ready | ~shown)
        m.d.comb += [
            part.column.eq(column),
            part.mask.eq(Cat(self._mask(rows[k], column) for k in range(self.config.group))),
            part.last.eq(at_end & ends),
            self.o.valid.eq(valid & shown),
            free.eq(~valid | (leaves & at_end)),
        ]
        with m.If(free):
            m.d.sync += [
                valid.eq(load),
                rows.eq(merged),
                part.row.eq(row.row >> self.bits),
                ends.eq(row.last),
                column.eq(Mux(found, first, 0)),
                most.eq(Mux(found, last, 0)),
            ]
        with m.Elif(leaves):
            m.d.sync += column.eq(column + 1)

    def _mask(self, tiles: data.View, column: Value) -> Value:
        """The tiles of an interval that are in a column of groups."""
        whole = (1 << self.config.group) - 1
        begin, end = tiles.begin >> self.bits, tiles.end >> self.bits
        offset = tiles.begin[: self.bits] if self.bits else Const(0)
        rest = ~tiles.end[: self.bits] if self.bits else Const(0)
        from_begin = Mux(column == begin, (whole << offset)[: self.config.group], whole)
        to_end = Mux(column == end, whole >> rest, whole)
        inside = (column >= begin) & (column <= end)
        return Mux(inside, from_begin & to_end, 0)[: self.config.group]
