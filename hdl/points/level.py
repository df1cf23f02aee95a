"""Choice of levels of detail: which chunk headers go on to be drawn (`spec.levels`)."""

from amaranth.hdl import Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Member, Out

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import passes
from splatcore.spec import point
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import CHUNK_HEADER

BEATS_BITS = point.BEATS_BITS - point.PLACE_BITS
"""Width of the beats of attributes before a chunk, over CHUNK."""

SPARED_BITS = 2
"""A turn costs as much as reading some 4 headers with their records: it is left out if the header
at which it begins is in the same 4 as the last one that it spares."""


def level_ports(levels: bool) -> dict[str, Member]:
    """Ports to control and reader of a part that chooses levels; none if machines have none."""
    if not levels:
        return {}
    return {
        "levels": In(1),  # the model has levels
        "fault": Out(1),  # a record contradicts its place, high for one cycle
        "turn": In(point.NUMBER_BITS),  # of the first chunk whose header is not asked for yet
        "jump": Out(1),  # the reader goes on at `target` instead, high for one cycle
        "target": Out(point.NUMBER_BITS),
    }


class Level(wiring.Component):
    """Passes on the chunk headers that a view draws, and drops the others.

    In models with levels a record comes before each header. The first record of a group is passed
    on too, to be tested. The walk takes one item after the other, whatever the records contain, so
    no record can stop it.

    Behind a group that is drawn or out of view headers are dropped up to its `jump`. If that is
    well beyond what the reader has asked for, the reader turns there, and only the headers on their
    way are dropped.

    Internal:
        of_header: the item at `i` is a header
        drawn: the header after the last record is drawn
        ends: the group of the last record was drawn or out of view: none of its subtree is needed
        again: the last record has the next one in its group
        skips, end: headers are dropped up to and including that of this number
        begins: headers are dropped from the next one on
        turning, until: after the header before this number comes that behind `end`

    **Timing**: combinational; items that are not passed on take one cycle. In models without levels
    all items are passed on.
    """

    def __init__(self):
        ports = {
            "number": In(point.NUMBER_BITS),  # of the chunk at `i`
            "last": In(point.NUMBER_BITS),  # of the model's last chunk
            # headers in the order of the model; records are in the same bits
            "i": In(stream_of(CHUNK_HEADER)),
            "o": Out(stream_of(CHUNK_HEADER)),  # headers that are drawn, and records to be tested
            "tests": Out(1),  # what is at `o` is a record
            # its group is coarse enough, or out of view; valid when the record is taken
            "enough": In(1),
            "out": In(1),
            "dropped": Out(1),  # a header is dropped, high for one cycle
            # behind the header at `i` comes that at `target`, with `beats` before its attributes
            "over": Out(1),
            "beats": Out(BEATS_BITS),
        }
        super().__init__(ports | level_ports(True))
        self.of_header, self.drawn, self.again = Signal(), Signal(), Signal()
        self.ends = Signal()
        self.skips, self.end = Signal(), Signal(point.NUMBER_BITS, reset_less=True)
        self.begins, self.turning = Signal(), Signal()
        self.until = Signal(point.NUMBER_BITS, reset_less=True)

    def elaborate(self, platform) -> Module:
        m = Module()
        record = data.View(layout(LEVEL), Value.cast(self.i.payload))
        coarse, on = record.error.any(), Signal()
        m.d.comb += [
            self.tests.eq(self.levels & ~self.of_header),
            on.eq(Mux(self.tests, coarse & ~self.again & ~self.skips, ~self.levels | self.drawn)),
            self.o.payload.eq(self.i.payload),
            self.o.valid.eq(self.i.valid & on),
            self.i.ready.eq(self.o.ready | ~on),
            self.dropped.eq(self.i.valid & ~self.tests & ~on),
        ]
        end, drawn, ends = Signal.like(self.end), Signal(), Signal()
        m.d.comb += end.eq(record.jump - 1)
        m.d.comb += [
            drawn.eq(
                ~self.skips & (~coarse | Mux(self.again, self.drawn, self.enough & ~self.out))
            ),
            ends.eq(~self.skips & coarse & Mux(self.again, self.ends, self.enough | self.out)),
        ]
        wrong = Mux(coarse, end <= self.number, (end != self.number) | self.again | ~record.last)
        wrong |= end > self.last
        m.d.sync += self.fault.eq(0)
        with m.If(passes(self.i) & self.levels):
            m.d.sync += self.of_header.eq(~self.of_header)
            with m.If(~self.of_header):
                m.d.sync += self.fault.eq(wrong)
                m.d.sync += [self.drawn.eq(drawn), self.again.eq(coarse & ~record.last)]
                m.d.sync += self.ends.eq(ends)
                with m.If(ends & record.last):
                    m.d.sync += [self.skips.eq(1), self.end.eq(end), self.beats.eq(record.beats)]
            with m.Elif((self.number == self.end) | self.over):
                m.d.sync += [self.skips.eq(0), self.turning.eq(0)]
                with m.If(self.over):
                    m.d.sync += self.again.eq(0)
        self._jump(m, wrong)
        return m

    def _jump(self, m: Module, wrong: Value):
        """Let the reader turn, if that spares it a header or more; not for a `wrong` record."""
        m.d.sync += self.begins.eq(0)
        with m.If(passes(self.i) & ~self.of_header & ~wrong):
            m.d.sync += self.begins.eq(~self.skips)
        far = self.turn[SPARED_BITS:] < self.end[SPARED_BITS:]
        m.d.comb += [
            self.target.eq(self.end + 1),
            self.jump.eq(self.begins & self.skips & far),
            self.over.eq(self.turning & (self.number + 1 == self.until)),
        ]
        with m.If(self.jump):
            m.d.sync += [self.turning.eq(1), self.until.eq(self.turn)]
