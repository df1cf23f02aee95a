"""The whole of stage 2 with zero-latency memory, for measurements and tests."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.record import layout
from splatcore.hdl.sorting.deal import Deal
from splatcore.hdl.sorting.sort import Sort
from splatcore.spec.binning import group_record
from splatcore.spec.config import Config
from splatcore.spec.group import entry_record, sorted_record
from splatcore.spec.sort import LINE_SLOTS, half_entries, line_record


class SortStage(wiring.Component):
    """Dealing, scratch memory and sorting.

    Members
        groups: stream of `group_record`
        short: stream of `entry_record`, the entries of lists that fit on chip
        long: stream of `entry_record`, the entries of longer lists, once per round of dealing
        stop: the rest of the current group's output is not needed
        o: stream of `sorted_record`

    **Timing**: as its parts; memory delivers one entry per cycle without latency.
    """

    def __init__(self, config: Config):
        self.config = config
        entry = layout(entry_record(config))
        ports = {
            "groups": In(stream.Signature(layout(group_record()))),
            "short": In(stream.Signature(entry)),
            "long": In(stream.Signature(entry)),
            "stop": In(1),
            "o": Out(stream.Signature(layout(sorted_record(config)))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.deal, m.submodules.sort = deal, sort = Deal(self.config), Sort(self.config)
        connect(m, flipped(self).groups, deal.groups)
        connect(m, flipped(self).long, deal.entries)
        connect(m, deal.jobs, sort.jobs)
        connect(m, sort.o, flipped(self).o)
        m.d.comb += [deal.released.eq(sort.released), sort.stop.eq(self.stop)]
        m.d.comb += [deal.reading.ready.eq(1), deal.settled.eq(1)]
        lines = 1 << line_record(self.config)["address"].width
        line, half = layout(line_record(self.config))["slots"].shape, half_entries(self.config)
        m.submodules.scratch = scratch = Memory(shape=line, depth=lines, init=[])
        write, read = scratch.write_port(), scratch.read_port(domain="comb")
        list_, place, left = deal.lists, Signal(range(lines * LINE_SLOTS)), Signal(range(half + 1))
        dealt = Signal()
        m.d.comb += [
            deal.lines.ready.eq(1),
            write.en.eq(deal.lines.valid),
            write.addr.eq(deal.lines.payload.address),
            write.data.eq(deal.lines.payload.slots),
            read.addr.eq(place >> (LINE_SLOTS - 1).bit_length()),
            sort.entries.valid.eq(left.any() & (dealt | self.short.valid)),
            sort.entries.payload.eq(
                Mux(dealt, read.data[place % LINE_SLOTS], Cat(self.short.payload))
            ),
            self.short.ready.eq(sort.entries.ready & left.any() & ~dealt),
            list_.ready.eq(~left.any()),
        ]
        with m.If(list_.ready & list_.valid):
            m.d.sync += [left.eq(list_.payload.count), dealt.eq(list_.payload.dealt)]
            m.d.sync += place.eq(list_.payload.page * half)
        with m.Elif(sort.entries.valid & sort.entries.ready):
            m.d.sync += [left.eq(left - 1), place.eq(place + 1)]
        return m
