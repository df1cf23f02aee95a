"""Properties to prove of the list writer.

One slot of one page, freely chosen, is followed: its expected value, and whether it was written.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from unittest.mock import patch

from amaranth.hdl import Array, Assert, Assume, Cat, Cover, Module, Mux, Signal, Value
from amaranth.lib.wiring import In
from amaranth.utils import exact_log2

from splatcore.hdl.binning.list_writer import ListWriter, State
from splatcore.spec.config import TINY, Config
from tb.formal.axi_rules import Around, constant, kept, within
from tb.formal.list_writer_why import why
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

GROUPS = 3  # not a power of two; 2 with planted faults
PAGE_BITS = 3  # few, so that the page numbers run out
COUNT_BITS = 4
SPLAT_BITS = 1

SHAPES = {"page4_burst2": (4, 2), "page8_burst2": (8, 2), "page4_burst4": (4, 4)}
"""Entries per page and per burst: 2, 4 and 1 bursts per page."""


def small(shape: str, groups: int = GROUPS) -> Config:
    """Return a machine for images of one row of `groups` groups, each of one tile."""
    page, burst = SHAPES[shape]
    digits = (1,) * 8
    sizes = {"page": page, "burst": burst, "sort_digits": digits}
    return replace(TINY, width_max=16 * groups, height_max=16, group=1, **sizes)


@contextmanager
def narrow() -> Iterator[None]:
    """Inside the context, page numbers, counts and entries have few bits."""
    with ExitStack() as stack:
        for name, bits in (
            ("spec.binning.PAGE_BITS", PAGE_BITS),
            ("spec.binning.COUNT_BITS", COUNT_BITS),
            ("hdl.binning.list_writer.COUNT_BITS", COUNT_BITS),
            ("spec.group.SPLAT_BITS", SPLAT_BITS),
        ):
            stack.enter_context(patch(f"splatcore.{name}", bits))
        yield


class Watched(ListWriter):
    """A list writer with observable memories.

    rows: the table
    buffers: for each k, slot k of all groups
    found_row, found_slots: row and slots of the current group, as the writer reads them
    noise: the value read from a row in the cycle in which it is written
    """

    def __init__(self, config: Config):
        with narrow():
            super().__init__(config)
        self.page_bits = PAGE_BITS
        self.rows = [Signal(self.row, name=f"row{g}") for g in range(self.count)]
        self.noise, self.found_row = Signal(self.row), Signal(self.row)
        self.clash = Signal()
        width, slots = len(Value.cast(self.held.entry)), range(self.burst - 1)
        self.found_slots = [Signal(width, name=f"found{k}") for k in slots]
        self.buffers = [
            [Signal(width, name=f"slot{k}_{g}") for g in range(self.count)] for k in slots
        ]

    def elaborate(self, platform) -> Module:
        with narrow():
            return super().elaborate(platform)

    def _memories(self, m: Module, asked: Value, ask: Value, group: Value):
        row, slots, write_row, write_entry = super()._memories(m, asked, ask, group)
        with m.If(ask):
            m.d.sync += self.clash.eq(write_row.en & (write_row.addr == asked))
        for g, watched in enumerate(self.rows):
            port = m.submodules.table.read_port(domain="comb")
            m.d.comb += [port.addr.eq(g), watched.eq(port.data)]
        for k, buffer in enumerate(self.buffers):
            for g, watched in enumerate(buffer):
                port = m.submodules[f"buffer{k}"].read_port(domain="comb")
                m.d.comb += [port.addr.eq(g), watched.eq(port.data)]
        found = Signal(self.row)
        m.d.comb += found.eq(Mux(self.clash, self.noise, row))
        return found, slots, write_row, write_entry

    def _present(self, m: Module, *args):
        row, slots = super()._present(m, *args)
        m.d.comb += self.found_row.eq(row)
        m.d.comb += [found.eq(slot) for found, slot in zip(self.found_slots, slots, strict=True)]
        return row, slots


class Written(Around):
    """A list writer, a frame's lists as defined, and one slot in memory.

    By definition a group's entries take the slots of its page one after the other. When only the
    page's last slot is free, the entry takes the first slot of the next unused page, and the last
    slot gets that page's number.

    Asserts:
    - bursts stay within the pages available;
    - the followed slot's burst is written at most once, with the slot's value, or 0 if it has none;
      at the end it has been written if the slot has a value;
    - groups come in order, each once, with first page and count;
    - `needed` is the number of pages taken, up to its largest value, and `exceeded` says whether
      this is more than the pages available;
    - an offer is kept until it is taken; an entry is accepted whenever a burst would be; at most 2
      cycles pass between groups.

    Assumes: an entry's group belongs to the image; no group has more entries than can be counted;
    image and pages are constant within a frame. Reset and `finish` may come in any cycle.
    """

    def __init__(self, part: Watched):
        word = len(Value.cast(part.held.entry))
        super().__init__(
            part, page=In(part.page_bits), slot=In(part.position_bits), noise=In(part.row.size)
        )
        self.page_bits, self.burst_bits = part.page_bits, exact_log2(part.burst)
        # By definition: the table's row per group; pages taken, up to one more than can be
        # numbered.
        self.lists = [Signal(part.row, name=f"list{g}") for g in range(part.count)]
        self.taken = Signal(part.page_bits + 1)
        # The same before the held entry.
        self.row_before, self.taken_before = Signal(part.row), Signal(part.page_bits + 1)
        # The followed slot: it has a value; from the latest entry; its burst was written; the value
        # and its group.
        self.seen, self.latest, self.written = Signal(), Signal(), Signal()
        self.value, self.owner = Signal(word), Signal(range(part.count))
        self.given = Signal(range(part.count + 1))  # groups that have left

    def elaborate(self, platform) -> Module:
        m, part = self.placed(), self.inner
        m.d.comb += part.noise.eq(self.noise)
        self._assume(m)
        self._lay_out(m)
        self._check_bursts(m)
        self._check_groups(m)
        why(self, m)
        for reset in (self.seen, self.written, self.given, self.taken, *self.lists):
            with m.If(part.done & ~part.finish):
                m.d.sync += reset.eq(0)
        return m

    def _assume(self, m: Module):
        part, between = self.inner, Signal()
        m.d.sync += between.eq(part.done & ~part.finish)
        constant(m, Cat(self.page, self.slot))
        constant(m, Cat(part.groups_count, part.pages), between)
        m.d.comb += [
            Assume((part.groups_count != 0) & (part.groups_count <= part.count)),
            Assume(~part.i.valid | (part.i.payload.group < part.groups_count)),
            Assume(self.page < part.pages),
        ]

    def _lay_out(self, m: Module):
        """Give each entry its slot, by definition."""
        part, most = self.inner, (1 << self.page_bits) - 1
        put, row, new = part.i.valid & part.i.ready, Signal(part.row), Signal(part.row)
        number, fresh = Mux(self.taken > most, most, self.taken), row.count == 0
        turn, link = fresh | row.position.all(), ~fresh & row.position.all()
        fills, links = Signal(), Signal()
        m.d.comb += [
            row.eq(Array(Value.cast(one) for one in self.lists)[part.i.payload.group]),
            new.page.eq(Mux(turn, number, row.page)),
            new.inside.eq(new.page < part.pages),
            new.position.eq(Mux(turn, 1, row.position + 1)),
            new.first.eq(Mux(fresh, number, row.first)),
            new.count.eq(row.count + 1),
            links.eq(link & (row.page == self.page) & self.slot.all()),
            fills.eq((new.page == self.page) & (new.position - 1 == self.slot) & ~links),
            Assume(~put | ~row.count.all()),
            Assert(~(put & (fills | links)) | (~self.seen & ~self.written)),
        ]
        with m.If(put):
            m.d.sync += [self.row_before.eq(row), self.taken_before.eq(self.taken)]
            m.d.sync += self.taken.eq(self.taken + (turn & (self.taken <= most)))
            m.d.sync += self.latest.eq(fills | links)
            with m.If(fills | links):
                m.d.sync += [self.seen.eq(1), self.owner.eq(part.i.payload.group)]
                m.d.sync += self.value.eq(Mux(links, number, part.i.payload.entry))
        for g, one in enumerate(self.lists):
            with m.If(put & (part.i.payload.group == g)):
                m.d.sync += one.eq(new)

    def _check_bursts(self, m: Module):
        part, bursts = self.inner, self.inner.bursts
        place = Cat(self.slot[self.burst_bits :], self.page)
        page = bursts.payload.address[len(place) - self.page_bits :]
        hit = bursts.valid & (bursts.payload.address == place)
        slots = Array(bursts.payload.slots[k] for k in range(part.burst))
        m.d.comb += [
            Assert(~bursts.valid | (page < part.pages)),
            Assert(~hit | ~self.written),
            Assert(~hit | (slots[self.slot[: self.burst_bits]] == Mux(self.seen, self.value, 0))),
            Assert(~part.done | ~self.seen | self.written),
            Assert(~part.taking | ~part.bursts.ready | part.i.ready),
        ]
        with m.If(hit & part.bursts.ready):
            m.d.sync += self.written.eq(1)
        kept(m, bursts.valid, bursts.ready, bursts.payload)

    def _check_groups(self, m: Module):
        part, groups, most = self.inner, self.inner.groups, (1 << self.page_bits) - 1
        row, passes = Signal(part.row), groups.valid & groups.ready
        held = part.full & part.taking  # the latest entry is still being handled
        m.d.sync += self.given.eq(self.given + passes)
        m.d.comb += [
            row.eq(Array(Value.cast(one) for one in self.lists)[self.given]),
            Assert(~groups.valid | (self.given < part.groups_count)),
            Assert(~groups.valid | (groups.payload.count == row.count)),
            Assert(~groups.valid | (groups.payload.page == row.first)),
            Assert(~part.done | (self.given == part.groups_count)),
            Assert(held | (part.needed == Mux(self.taken > most, most, self.taken))),
            Assert(held | (part.exceeded == (self.taken > part.pages))),
            Assert(~part.done | ~part.full),
        ]
        kept(m, groups.valid, groups.ready, groups.payload)
        flushing = part.state == State.FLUSH
        within(m, flushing & part.bursts.ready & groups.ready & ~passes, 2)
        full = self.written & self.slot.all()  # the followed slot is a link
        m.d.comb += Cover(part.done & full & (part.groups_count == part.count) & part.exceeded)
        m.d.comb += Cover(part.done & full & ~part.exceeded & (part.needed == part.pages))


COVER_DEPTH = 16  # cycles within which a list of two pages can be written, and a page be missing
FAULT_DEPTH = 12  # cycles within which every fault below shows

FAULTS = planted_in(
    ListWriter,
    _handle={
        "two lists have a page": ("~flushing & turn)", "~flushing & fresh)"),
        "a page beyond the last": ("needed < self.pages", "needed <= self.pages"),
        "the last page is not used": ("needed < self.pages", "needed + 1 < self.pages"),
        "a page where the one before was": ("(turn, inside,", "(fresh, inside,"),
        "a missing page is not reported": ("m.If(~inside)", "m.If(0)"),
        "a link to its own page": ("page_full, self.needed", "page_full, row.page"),
        "a link takes an entry's slot": ("(turn, 1,", "(turn, 2,"),
        "a first entry in a wrong slot": ("Mux(turn, 0, offset)", "offset"),
        "a burst twice": ("written & ~had_burst", "written"),
        "a list twice": ("flushing & ~had_group", "flushing"),
        "an entry behind a list": ("Mux(flushing, 0, final)", "final"),
        "a row of the frame before": ("Mux(self.taking, Val", "Mux(1, Val"),
    },
    _present={
        "a stale row": ("take & through & (held", "0 & (held"),
        "a stale entry": ("same & (slot == k)", "0"),
    },
    elaborate={
        "a row from before the reset": ("self.count - 1", "self.count - 2"),
        "flushed with an entry inside": ("free & ~self.i.valid", "free"),
    },
)


def part(*shape, **about) -> Part:
    return Part(lambda: Written(Watched(small(*shape))), **about)


PROOF = Proof(
    {shape: part(shape, cover=None if k else COVER_DEPTH) for k, shape in enumerate(SHAPES)},
    FAULTS,
    {"": part("page4_burst2", 2, search=FAULT_DEPTH)},
)
