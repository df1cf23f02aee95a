"""Reads the entries of each group from the pages of its list in memory."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.fetch import Fetch, Unpack, unpacked
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, BURST_BEATS, DATA_BITS, read_record
from splatcore.spec.binning import PAGE_BITS, group_record
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, ENTRY_BITS, entry_record
from splatcore.spec.work import SLOT, page_bytes

PAGES_WAITING = 2
"""Pages of entries that may wait: the next one is asked for as soon as its number has come."""


class ListReader(wiring.Component):
    """Follows the lists of groups from page to page.

    Members
        lists_at: address of the pages, in beats.
        i: stream of `group_record`.
        o: stream of `entry_record`, those of one group after those of the other.
        reads, data: to and from memory.

    **Timing**: an entry a cycle; from a page's last beat to the request for the next one 2 cycles.
    The last slot of a page is the next page's number; of a list's last page only the beats with
    entries are read.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "lists_at": In(BEAT_ADDRESS_BITS),
            "i": In(stream.Signature(layout(group_record()))),
            "o": Out(stream.Signature(layout(entry_record(config)))),
            "reads": Out(stream.Signature(layout(read_record()))),
            "data": In(stream.Signature(read_beat())),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        beats = page_bytes(self.config) // BEAT
        depth = max(PAGES_WAITING * beats, 2 * BURST_BEATS)
        page_bits = self.config.page.bit_length()
        fetch, unpack = unpacked(m, self, depth, beats.bit_length(), page_bits)
        m.d.comb += [self.o.valid.eq(unpack.o.valid), self.o.payload.eq(unpack.o.payload)]
        m.d.comb += unpack.o.ready.eq(self.o.ready)
        self._pages(m, fetch, unpack, beats)
        return m

    def _pages(self, m: Module, fetch: Fetch, unpack: Unpack, beats: int):
        """A page after the other; a page's number comes with the last beat of the one before."""
        left, page = Signal(COUNT_BITS), Signal(PAGE_BITS)
        goes_on = left >= self.config.page  # then the page's last slot is a link
        count = Mux(goes_on, self.config.page - 1, left)
        slots_a_beat = BEAT // SLOT
        wanted = Mux(goes_on, beats, (left + slots_a_beat - 1) // slots_a_beat)
        asked, counted = Signal(), Signal()  # the page's beats; its count has gone to `unpack`
        ahead = Signal(range(4 * fetch.depth))  # beats on their way
        link = self.data.payload.beat[DATA_BITS - ENTRY_BITS :][:PAGE_BITS]
        comes = self.data.valid & self.data.ready
        through, begins = Signal(), Signal()
        m.d.comb += fetch.i.payload.beat.eq(self.lists_at + page * beats)
        m.d.comb += [fetch.i.payload.count.eq(wanted), unpack.counts.payload.eq(count)]
        with m.FSM():
            with m.State("GROUP"):
                m.d.comb += self.i.ready.eq(1)
                m.d.sync += [left.eq(self.i.payload.count), page.eq(self.i.payload.page)]
                with m.If(self.i.valid & (self.i.payload.count != 0)):
                    m.next = "PAGE"
            with m.State("PAGE"):
                m.d.comb += [
                    fetch.i.valid.eq(~asked & (ahead < 2 * fetch.depth)),
                    unpack.counts.valid.eq(~counted),
                    begins.eq(fetch.i.valid & fetch.i.ready),
                    through.eq((asked | begins) & (counted | unpack.counts.ready)),
                ]
                m.d.sync += asked.eq((asked | begins) & ~through)
                m.d.sync += counted.eq((counted | unpack.counts.ready) & ~through)
                with m.If(through):
                    m.d.sync += left.eq(left - count)
                    m.next = "GROUP"
                    with m.If(goes_on):
                        m.next = "LINK"
            with m.State("LINK"), m.If(comes & (ahead == 1)):
                m.d.sync += page.eq(link)
                m.next = "PAGE"
        m.d.sync += ahead.eq(ahead + Mux(begins, wanted, 0) - comes)
