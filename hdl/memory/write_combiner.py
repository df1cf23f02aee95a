"""Gathers slots of a few bytes at neighbouring addresses into bursts."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.memory.axi import write_data
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, LINE, LINE_BEATS, write_record
from splatcore.spec.config import Config


class WriteCombiner(wiring.Component):
    """Gathers slots of `size` bytes into lines.

    A slot is added to the line if it is of the same line and behind its last slot. The line is
    written when its last slot has come, when a slot comes that cannot be added, or when `flush` is
    high.

    Parameters:
        size: bytes per slot

    **Timing**: a line of consecutive slots takes one cycle more than it has slots: while its second
    beat is offered, slots of the next line's first beat are taken. No path, no multiplier. A port
    as wide as a line has no second beat.
    """

    def __init__(self, config: Config, size: int):
        self.config, self.size = config, size
        self.slots, self.beat_slots = LINE // size, config.port // 8 // size
        address = BEAT_ADDRESS_BITS + exact_log2(BEAT // size)
        slot = data.StructLayout({"slot": address, "data": size * 8})
        ports = {
            "i": In(stream.Signature(slot)),  # {slot, data}: address in slots, and data
            "flush": In(1),  # write the gathered slots
            # one burst of `LINE_BEATS` beats per line, without strobes for missing slots
            "writes": Out(stream_of(write_record(config))),
            "empty": Out(1),  # all slots that came have been taken from `writes`
        }
        super().__init__(ports)
        self.line_bits = address - exact_log2(self.slots)

    def elaborate(self, platform) -> Module:
        m = Module()
        slots = data.ArrayLayout(self.size * 8, self.slots)
        gathered, present = Signal(slots, reset_less=True), Signal(self.slots)
        line, written = (
            Signal(self.line_bits, name=name, reset_less=True) for name in ("line", "written")
        )
        offers, second = Signal(), Signal()  # a beat is offered; it is the line's second one
        slot = self.i.payload.slot
        position, address = slot[: -self.line_bits], slot[-self.line_bits :]
        # While the second beat is offered, its slots belong to the line before.
        of_line = Signal(self.slots)
        behind, fits, room = Signal(), Signal(), Signal()
        m.d.comb += [
            of_line.eq(Mux(second, present[: self.beat_slots], present)),
            behind.eq((of_line >> position) == 0),
            fits.eq(~of_line.any() | ((address == line) & behind)),
            room.eq(~offers | (second & ~position[-1])),
            self.i.ready.eq(fits & room),
            self.empty.eq(~present.any() & ~second),
        ]
        m.d.comb += self.writes.valid.eq(offers)
        self._data(m, gathered, present, written, second)
        left = self.writes.valid & self.writes.ready
        with m.If(left & ~second):
            two = self.beat_slots < self.slots
            m.d.sync += [offers.eq(two), second.eq(two), present[: self.beat_slots].eq(0)]
        with m.If(left & second):
            m.d.sync += [offers.eq(0), second.eq(0), present[self.beat_slots :].eq(0)]
        takes = self.i.valid & self.i.ready
        with m.If(takes):
            m.d.sync += line.eq(address)
            for k in range(self.slots):
                with m.If(position == k):
                    m.d.sync += [gathered[k].eq(self.i.payload.data), present[k].eq(1)]
        whole = takes & position.all()
        with m.If(~offers & (whole | (present.any() & (self.flush | (self.i.valid & ~fits))))):
            m.d.sync += [offers.eq(1), written.eq(Mux(whole, address, line))]
        return m

    def _data(self, m: Module, gathered, present, written, second: Value):
        """Drive one beat of the line."""
        bits, size = self.config.port, self.config.port // 8
        data, strobes = Value.cast(gathered), Cat(bit.replicate(self.size) for bit in present)
        m.d.comb += [
            self.writes.payload.beat.eq(written << exact_log2(LINE_BEATS)),
            self.writes.payload.length.eq(self.slots // self.beat_slots - 1),
            self.writes.payload.strobe.eq(Mux(second, strobes[size:], strobes[:size])),
            write_data(self.config, self.writes.payload).eq(Mux(second, data[bits:], data[:bits])),
        ]
