"""Properties of the list reader, to check by a search within a bounded number of cycles.

Memory contents and response times are free.
"""

from dataclasses import replace

from amaranth.hdl import Array, Assert, Assume, Cat, Const, Cover, Module, Mux, ResetSignal, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import Queue, passes
from splatcore.hdl.raster.list_reader import ListReader
from splatcore.spec.config import TINY
from tb.formal.axi_rules import constant
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

SMALL = replace(TINY, page=4, burst=2, sort_digits=(1,) * 8)

PAGES, SLOTS, BITS = 2, SMALL.page, 1  # free bits per entry or link
BEAT_SLOTS = 2

WAITING = 4  # beats that may wait in the reader


class Read(wiring.Component):
    """A list reader, and a memory that answers each request after any number of cycles.

    Asserts:
    - the entries are those of the list's first page without its last slot, then of the page that
      this slot names, and so on, up to the list's count; one list follows the other;
    - no beat beyond the pages is requested.

    Assumes: memory contents stay constant, and there is no further reset.
    """

    def __init__(self):
        bits = dict.fromkeys(("valid", "ready", "takes", "gives"), In(1))
        memory = In(PAGES * SLOTS * BITS)
        super().__init__(bits | {"memory": memory, "page": In(1), "count": In(3)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = ListReader(SMALL, depth=WAITING, burst=2)
        m.submodules.asked = asked = Queue(part.reads.payload.shape(), 2)
        m.submodules.lists = lists = Queue(4, 2)
        constant(m, self.memory)
        m.d.comb += [
            Assume(~ResetSignal()),
            part.i.valid.eq(self.valid & lists.i.ready),
            part.i.payload.page.eq(self.page),
            part.i.payload.count.eq(self.count),
            lists.i.payload.eq(Cat(self.page, self.count)),
            lists.i.valid.eq(self.valid & part.i.ready & (self.count != 0)),
            part.o.ready.eq(self.ready),
            asked.i.payload.eq(part.reads.payload),
            asked.i.valid.eq(part.reads.valid & self.takes),
            part.reads.ready.eq(asked.i.ready & self.takes),
        ]
        slots = [self.memory.word_select(k, BITS) for k in range(PAGES * SLOTS)]
        beats = Array(
            Cat(Cat(slot, Const(0, 64 - BITS)) for slot in slots[k : k + BEAT_SLOTS])
            for k in range(0, len(slots), BEAT_SLOTS)
        )
        beat, data = Signal(8), part.data
        request = asked.o.payload
        m.d.comb += [
            data.valid.eq(asked.o.valid & self.gives),
            data.payload.beat.eq(beats[request.beat + beat]),
            data.payload.last.eq(beat == request.length),
            asked.o.ready.eq(self.gives & data.payload.last),
            Assert(~part.reads.valid | (part.reads.payload.beat < PAGES * SLOTS // BEAT_SLOTS)),
        ]
        with m.If(passes(data)):
            m.d.sync += beat.eq(Mux(data.payload.last, 0, beat + 1))
        self._walk(m, part, lists, slots)
        return m

    def _walk(self, m: Module, part: ListReader, lists: Queue, slots: list):
        """Check the entries against the definition: slot by slot, then on to the next page."""
        slot, turned, now = Signal(2), Signal(), Signal()
        left, given = Signal(3), Signal(3)
        page = Mux(turned, now, lists.o.payload[0])
        m.d.comb += left.eq(lists.o.payload[1:] - given)
        wanted = Array(slots)[Cat(slot, page)]
        o = part.o
        m.d.comb += [
            Assert(~o.valid | lists.o.valid),
            Assert(~o.valid | (o.payload.as_value() == wanted)),
            lists.o.ready.eq(passes(o) & (left == 1)),
            Cover(passes(o) & turned & (left == 1)),
        ]
        with m.If(passes(o)):
            m.d.sync += [slot.eq(slot + 1), given.eq(given + 1)]
            with m.If(left == 1):
                m.d.sync += [slot.eq(0), turned.eq(0), given.eq(0)]
            with m.Elif(slot == SLOTS - 2):
                m.d.sync += [slot.eq(0), turned.eq(1)]
                m.d.sync += now.eq(Array(slots)[Cat(Const(SLOTS - 1, 2), page)])


DEPTH = 12  # cycles within which a list of two pages can be read; one more doubles the run time

FAULTS = planted_in(
    ListReader,
    _pages={
        "a link is taken for an entry": (
            "goes_on, self.config.page - 1,",
            "goes_on, self.config.page,",
        ),
        "a full page has no link": ("left >= self.config.page", "left > self.config.page"),
        "a link that has not come": ("ahead.goes & (ahead.count == 1)", "ahead.goes"),
        "a link in the wrong slot": ("beat[-ENTRY_BITS:]", "beat[:ENTRY_BITS]"),
        "a page at a wrong address": ("self.lists_at + page * beats", "self.lists_at + page"),
        "a beat too few": ("(left + slots_a_beat - 1)", "left"),
    },
)

PROOF = Proof({"lists": Part(Read, search=DEPTH, cover=DEPTH)}, FAULTS)
