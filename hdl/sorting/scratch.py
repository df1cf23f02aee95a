"""Scratch memory of sorting: writes runs of long lists to DRAM and reads them back."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.record import layout
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.fetch import unpacked
from splatcore.hdl.memory.write_combiner import WriteCombiner
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, BURST_BEATS, read_record, write_record
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, entry_record
from splatcore.spec.sort import AREAS, read_entries, spill_record, wanted_record
from splatcore.spec.work import SLOT

BEATS_WAITING = 2 * BURST_BEATS  # beats that may wait on their way back


class Scratch(wiring.Component):
    """Writes runs of entries to scratch memory, in lines, and reads pieces of them.

    Pieces are read only when all that was written to their area has arrived in memory.

    Members
        scratch_at: address of area 0; area_beats: distance from there to area 1; both in beats.
        spill, wanted, back: those of `hdl.sorting.sort`.
        settled: all that this has written is in memory.
        reads, data, writes: to and from memory.

    **Timing**: an entry a cycle each way.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "scratch_at": In(BEAT_ADDRESS_BITS),
            "area_beats": In(BEAT_ADDRESS_BITS),
            "spill": In(stream.Signature(layout(spill_record(config)))),
            "wanted": In(stream.Signature(layout(wanted_record(config)))),
            "back": Out(stream.Signature(layout(entry_record(config)))),
            "settled": In(1),
            "reads": Out(stream.Signature(layout(read_record()))),
            "data": In(stream.Signature(read_beat())),
            "writes": Out(stream.Signature(layout(write_record()))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        starts = [Signal(BEAT_ADDRESS_BITS, name=f"start{k}") for k in range(AREAS)]
        first, second = starts
        m.d.sync += [first.eq(self.scratch_at), second.eq(self.scratch_at + self.area_beats)]
        pending, written = self._spill(m, starts)
        self._read(m, starts, pending, written)
        return m

    def _spill(self, m: Module, starts: list[Signal]) -> tuple[Signal, Signal]:
        """Entries to lines; returns bits that say that some are on their way, and to which area."""
        m.submodules.line = line = WriteCombiner()
        connect(m, line.writes, flipped(self.writes))
        address, slots = self.spill.payload.address, BEAT // SLOT
        area, position = address[COUNT_BITS:], address[:COUNT_BITS]
        begin = Mux(area, starts[1], starts[0])
        written, pending = Signal(), Signal()
        m.d.comb += [
            line.i.valid.eq(self.spill.valid),
            line.i.payload.slot.eq(begin * slots + position),
            line.i.payload.data.eq(self.spill.payload.entry.as_value()),
            self.spill.ready.eq(line.i.ready),
            pending.eq(self.spill.valid | ~line.empty | ~self.settled),
            line.flush.eq(self.wanted.valid),
        ]
        with m.If(self.spill.valid):
            m.d.sync += written.eq(area)
        return pending, written

    def _read(self, m: Module, starts: list[Signal], pending: Signal, written: Signal):
        """Pieces as ranges of beats."""
        count_bits = read_entries(self.config).bit_length()
        fetch, unpack = unpacked(m, self, BEATS_WAITING, count_bits, count_bits)
        wanted, slots = self.wanted.payload, BEAT // SLOT
        area, position = wanted.address[COUNT_BITS:], wanted.address[:COUNT_BITS]
        begin = Mux(area, starts[1], starts[0])
        may = ~(pending & (written == area))
        m.d.comb += [
            fetch.i.valid.eq(self.wanted.valid & may & unpack.counts.ready),
            fetch.i.payload.beat.eq(begin + position // slots),
            fetch.i.payload.count.eq((wanted.count + slots - 1) // slots),
            unpack.counts.valid.eq(self.wanted.valid & may & fetch.i.ready),
            unpack.counts.payload.eq(wanted.count),
            self.wanted.ready.eq(may & fetch.i.ready & unpack.counts.ready),
            self.back.valid.eq(unpack.o.valid),
            self.back.payload.eq(Cat(unpack.o.payload)),
            unpack.o.ready.eq(self.back.ready),
        ]
