"""Remembers which beats of features were read last, so that none is read twice for its halves."""

from amaranth.hdl import Const, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Stage, passes
from splatcore.spec.axi import port_beats
from splatcore.spec.config import Config
from splatcore.spec.group import SPLAT_BITS, sorted_record


class Recent(wiring.Component):
    """Gives each splat the row of its feature's beat: where it is kept, or the next row.

    Rows are used in turn. A beat is found if it has one of the last `kept` rows, and was given it
    for the same group, a few cycles before.

    Internal:
        next: row of the next beat
        fresh: beats that were given a row for this group, up to `kept`

    **Timing**: latency 2, one splat per cycle. A path from `o.ready` to `i.ready`. Memories: a
    row per place, where it is looked for by the lower bits of the beat, and the beat of each row.
    With `kept` 0, all beats are new: latency 0, no memories, paths from `i` to `o`.
    """

    def __init__(self, config: Config, rows: int, kept: int):
        self.row_bits, self.kept = exact_log2(rows), kept
        self.half_bits = exact_log2(port_beats(config))  # that select the feature in a beat
        self.sorted = layout(sorted_record(config))
        sought = {"sorted": self.sorted, "row": self.row_bits, "new": 1}
        ports = {
            "i": In(stream_of(sorted_record(config))),
            # row: of the splat's beat; new: which is to be read
            "o": Out(stream.Signature(data.StructLayout(sought))),
        }
        super().__init__(ports)
        self.next, self.fresh = Signal(self.row_bits), Signal(range(kept + 1))

    def elaborate(self, platform) -> Module:
        m = Module()
        now, old, row = self._found(m) if self.kept else self._none(m)
        o, comes = self.o, passes(self.o)
        m.d.comb += [
            o.payload.sorted.eq(now),
            o.payload.new.eq(~old & ~now.end),
            o.payload.row.eq(Mux(old, row, self.next)),
        ]
        with m.If(comes & o.payload.new):
            m.d.sync += self.next.eq(self.next + 1)
        return m

    def _none(self, m: Module) -> tuple[data.View, Value, Value]:
        """No beat is kept."""
        m.d.comb += [self.o.valid.eq(self.i.valid), self.i.ready.eq(self.o.ready)]
        return self.i.payload, Const(0), Const(0, self.row_bits)

    def _found(self, m: Module) -> tuple[data.View, Value, Value]:
        """Look a splat's beat up: the splat, whether the beat is kept, and in which row."""
        looked_up = data.StructLayout({"sorted": self.sorted, "row": self.row_bits})
        m.submodules.first = first = Stage(self.sorted)
        m.submodules.second = second = Stage(looked_up)
        rows, beat_bits = 1 << self.row_bits, SPLAT_BITS - self.half_bits
        m.submodules.places = places = Memory(shape=self.row_bits, depth=rows, init=[])
        m.submodules.beats = beats = Memory(shape=beat_bits, depth=rows, init=[])
        place, beat = places.read_port(), beats.read_port()
        found, now = second.o.payload, second.o.payload.sorted
        beat_of = now.splat[self.half_bits :]
        connect(m, flipped(self).i, first.i)
        m.d.comb += [
            place.addr.eq(self.i.payload.splat[self.half_bits :]),
            place.en.eq(passes(self.i)),
            second.i.valid.eq(first.o.valid),
            second.i.payload.sorted.eq(first.o.payload),
            second.i.payload.row.eq(place.data),
            first.o.ready.eq(second.i.ready),
            beat.addr.eq(place.data),
            beat.en.eq(passes(second.i)),
        ]
        behind, old, written = Signal.like(self.next), Signal(), Signal()
        new = passes(self.o) & self.o.payload.new
        m.d.comb += [
            behind.eq(self.next - 1 - found.row),
            old.eq((beat.data == beat_of) & ~written & (behind < self.fresh)),
            self.o.valid.eq(second.o.valid),
            second.o.ready.eq(self.o.ready),
        ]
        for memory, at, value in ((places, beat_of, self.next), (beats, self.next, beat_of)):
            write = memory.write_port()
            m.d.comb += [write.en.eq(new), write.data.eq(value)]
            m.d.comb += write.addr.eq(at)
        with m.If(beat.en):
            # A row may have been given in the cycle in which it was read.
            m.d.sync += written.eq(new & (place.data == self.next))
        with m.If(passes(self.o) & now.end):
            m.d.sync += self.fresh.eq(0)
        with m.Elif(new & (self.fresh != self.kept)):
            m.d.sync += self.fresh.eq(self.fresh + 1)
        return now, old, found.row
