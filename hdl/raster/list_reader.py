"""Reads the entries of each group from the pages of its list in memory."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import passes
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.fetch import Fetch, Unpack, unpacked
from splatcore.spec.axi import BEAT, BEAT_ADDRESS_BITS, read_record, window_bits
from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, ENTRY_BITS, entry_record
from splatcore.spec.sort import half_entries, listed_record
from splatcore.spec.work import SLOT, page_bytes

BEATS_WAITING = 48
"""Beats of entries that may wait to be sorted, while others are in flight."""

LONG_BEATS_WAITING = 40
"""The same for entries to be dealt: more than a page, as its last slot names the next one."""

BURST, LONG_BURST = 8, 4
"""Beats per request, for the same two kinds."""


class ListReader(wiring.Component):
    """Reads lists: lists of groups page by page, dealt lists (`spec.sort`) in one go.

    Parameters:
        depth: beats that may wait
        burst: beats per request

    **Timing**: one entry per cycle; two cycles from a page's last beat to the request for the next
    page. The last slot of a page is the number of the next page; of a list's last page only the
    beats with entries are read.
    """

    def __init__(self, config: Config, depth: int = BEATS_WAITING, burst: int = BURST):
        self.config, self.depth, self.burst = config, depth, burst
        ports = {
            # addresses of the pages and of the buckets, in beats
            "lists_at": In(BEAT_ADDRESS_BITS),
            "scratch_at": In(BEAT_ADDRESS_BITS),
            "i": In(stream_of(listed_record())),
            "o": Out(stream_of(entry_record(config))),  # list by list
            "reads": Out(stream_of(read_record())),  # to memory
            "data": In(stream.Signature(read_beat(config))),  # from memory
        }
        if window_bits(config):
            ports["in_scratch"] = Out(1)  # the request at `reads` is for scratch memory
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        beats, bucket = page_bytes(self.config) // BEAT, half_entries(self.config)
        count_bits = max(self.config.page, bucket).bit_length()
        longest = max(beats, bucket * SLOT // BEAT)  # maximum number of beats read in one go
        marks = bool(window_bits(self.config))
        fetch = Fetch(self.config, self.depth, longest.bit_length(), self.burst, marks)
        unpack = Unpack(self.config, count_bits)
        unpacked(m, self, fetch, unpack)
        m.d.comb += [self.o.valid.eq(unpack.o.valid), self.o.payload.eq(unpack.o.payload)]
        m.d.comb += unpack.o.ready.eq(self.o.ready)
        step = -(-longest // fetch.beats)
        m.submodules.ahead = ahead = Credit(
            2 * fetch.depth - 1 + step, "beats of lists in flight", step=step
        )
        self._pages(m, fetch, unpack, beats, ahead)
        return m

    def _pages(self, m: Module, fetch: Fetch, unpack: Unpack, beats: int, ahead: Credit):
        """Read page after page; a page's number comes with the last beat of the previous page."""
        left, page, dealt = Signal(COUNT_BITS), Signal(PAGE_BITS), Signal()
        goes_on = (left >= self.config.page) & ~dealt  # if so, the page's last slot is a link
        count = Mux(goes_on, self.config.page - 1, left)
        slots_a_beat = BEAT // SLOT
        wanted = Mux(goes_on, beats, (left + slots_a_beat - 1) // slots_a_beat)
        counted = Signal()  # `unpack` has the page's count; only then the page is requested
        of_port = (wanted + fetch.beats - 1) >> exact_log2(fetch.beats)
        link = self.data.payload.beat[-ENTRY_BITS:][:PAGE_BITS]
        begins = Signal()
        m.d.comb += [ahead.comes.eq(Mux(begins, of_port, 0)), ahead.goes.eq(passes(self.data))]
        bucket = self.scratch_at + page * (half_entries(self.config) // slots_a_beat)
        m.d.comb += fetch.i.payload.beat.eq(Mux(dealt, bucket, self.lists_at + page * beats))
        m.d.comb += [fetch.i.payload.count.eq(wanted), unpack.counts.payload.eq(count)]
        if fetch.has_marks:
            m.d.comb += [fetch.marks.eq(dealt), self.in_scratch.eq(fetch.marked)]
        with m.FSM():
            with m.State("GROUP"):
                m.d.comb += self.i.ready.eq(1)
                m.d.sync += [left.eq(self.i.payload.count), page.eq(self.i.payload.page)]
                m.d.sync += dealt.eq(self.i.payload.dealt)
                with m.If(self.i.valid & (self.i.payload.count != 0)):
                    m.next = "PAGE"
            with m.State("PAGE"):
                few = ahead.count < 2 * fetch.depth
                m.d.comb += [
                    unpack.counts.valid.eq(~counted),
                    fetch.i.valid.eq((counted | unpack.counts.ready) & few),
                    begins.eq(passes(fetch.i)),
                ]
                m.d.sync += counted.eq((counted | unpack.counts.ready) & ~begins)
                with m.If(begins):
                    m.d.sync += left.eq(left - count)
                    m.next = "GROUP"
                    with m.If(goes_on):
                        m.next = "LINK"
            with m.State("LINK"), m.If(ahead.goes & (ahead.count == 1)):
                m.d.sync += page.eq(link)
                m.next = "PAGE"
