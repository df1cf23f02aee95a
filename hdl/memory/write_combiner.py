"""Gathers slots of 8 bytes that are written to neighbouring addresses into bursts."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, LINE_BEATS, write_record
from splatcore.spec.work import SLOT

BEAT_SLOTS = BEAT // SLOT
SLOTS = LINE_BEATS * BEAT_SLOTS


class WriteCombiner(wiring.Component):
    """Slots of 8 bytes in, lines out.

    A slot is gathered with those before it if it is of their line and behind the last of them.
    The line goes out when its last slot has come, when a slot comes that cannot be gathered with
    it, or when `flush` is high.

    Members
        i: stream of slots: address (in slots), data.
        flush: while it is high, what is gathered goes out.
        writes: stream of `write_record`: bursts of `LINE_BEATS` beats, a line each, without strobes
            for slots that have not come.
        empty: all that came has been taken from `writes`.

    **Timing**: four consecutive slots every 5 cycles: while the second beat of a line is offered,
    slots of the next line's first beat are taken. No path, no multiplier.
    """

    def __init__(self):
        address = BEAT_ADDRESS_BITS + exact_log2(BEAT_SLOTS)
        slot = data.StructLayout({"slot": address, "data": SLOT * 8})
        ports = {
            "i": In(stream.Signature(slot)),
            "flush": In(1),
            "writes": Out(stream.Signature(layout(write_record()))),
            "empty": Out(1),
        }
        super().__init__(ports)
        self.line_bits = address - exact_log2(SLOTS)

    def elaborate(self, platform) -> Module:
        m = Module()
        slots = data.ArrayLayout(SLOT * 8, SLOTS)
        gathered, present = Signal(slots, reset_less=True), Signal(SLOTS)
        line, written = (
            Signal(self.line_bits, name=name, reset_less=True) for name in ("line", "written")
        )
        first, second = Signal(), Signal()  # the beat that is offered
        slot = self.i.payload.slot
        position, address = slot[: -self.line_bits], slot[-self.line_bits :]
        # While the second beat is offered, its slots belong to the line before.
        of_line = Signal(SLOTS)
        behind, fits, room = Signal(), Signal(), Signal()
        m.d.comb += [
            of_line.eq(Mux(second, present[:BEAT_SLOTS], present)),
            behind.eq((of_line >> position) == 0),
            fits.eq(~of_line.any() | ((address == line) & behind)),
            room.eq(~first & ~(second & position[-1])),
            self.i.ready.eq(fits & room),
            self.empty.eq(~present.any() & ~second),
        ]
        self._offer(m, gathered, present, written, first, second)
        left = self.writes.valid & self.writes.ready
        with m.If(left & first):
            m.d.sync += [first.eq(0), second.eq(1), present[:BEAT_SLOTS].eq(0)]
        with m.If(left & second):
            m.d.sync += [second.eq(0), present[BEAT_SLOTS:].eq(0)]
        takes = self.i.valid & self.i.ready
        with m.If(takes):
            m.d.sync += line.eq(address)
            for k in range(SLOTS):
                with m.If(position == k):
                    m.d.sync += [gathered[k].eq(self.i.payload.data), present[k].eq(1)]
        whole = takes & position.all()
        with m.If(
            ~first & ~second & (whole | (present.any() & (self.flush | (self.i.valid & ~fits))))
        ):
            m.d.sync += [first.eq(1), written.eq(Mux(whole, address, line))]
        return m

    def _offer(self, m: Module, gathered, present, written, first: Value, second: Value):
        """A beat of the line."""
        half = SLOT * 8 * BEAT_SLOTS
        beat = Signal(half)
        strobes = Cat(bit.replicate(SLOT) for bit in present)
        m.d.comb += [
            beat.eq(Mux(second, Value.cast(gathered)[half:], Value.cast(gathered)[:half])),
            self.writes.valid.eq(first | second),
            self.writes.payload.beat.eq(written << exact_log2(LINE_BEATS)),
            self.writes.payload.length.eq(LINE_BEATS - 1),
            self.writes.payload.strobe.eq(Mux(second, strobes[BEAT:], strobes[:BEAT])),
            Cat(self.writes.payload.low, self.writes.payload.high).eq(beat),
        ]
