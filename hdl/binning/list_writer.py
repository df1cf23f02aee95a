"""Binning, last step: writes the groups' entries to linked lists in memory, in bursts."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, enum, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.shift import plus_one
from splatcore.spec import binning
from splatcore.spec.config import Config
from splatcore.spec.group import COUNT_BITS, entry_record


class State(enum.Enum):
    """Phases of the list writer."""

    CLEAR = 0  # after reset: the table's rows are cleared
    TAKE = 1  # entries come
    FLUSH = 2  # each group's last burst and its list are output
    DONE = 3  # all groups have been output


class ListWriter(wiring.Component):
    """Writes entries in bursts; at the end of the frame, outputs all groups' lists.

    A table holds, for each group, its current page and whether that is in list memory, the slots
    used there, its first page and its number of entries; write buffers hold up to burst − 1 entries
    per group. An entry that finds its group's buffer full completes a burst. If the page's last
    slot is next, the burst ends with the number of a new page instead, and the entry is the first
    one there. So a page is taken when an entry needs it, and an entry causes at most one burst.

    Internal:
        state: the phase
        group, flushed: the next group to flush; there is none
        held, full: the entry or group being handled; there is one
        same: the previous entry was of the same group
        had_burst, had_group: its burst and its list have been output

    **Timing**: one entry per cycle whatever its group, latency 1; one group per cycle when flushed.
    After reset, one cycle per group. An entry that follows another of its group would read the
    table while that is written: it takes the row and the entry from registers instead, so no memory
    has to return data written in the same cycle. No multiplier.
    """

    def __init__(self, config: Config):
        self.config, self.count = config, max(2, binning.groups_max(config))  # addresses have bits
        self.burst = config.burst
        self.position_bits = exact_log2(binning.bursts_per_page(config) * config.burst)
        self.row = data.StructLayout(
            {
                "page": binning.PAGE_BITS,
                "inside": 1,
                "position": self.position_bits,
                "first": binning.PAGE_BITS,
                "count": COUNT_BITS,
            }
        )
        ports = {
            "i": In(stream_of(binning.bin_entry_record(config))),
            "groups_count": In(range(self.count + 1)),  # number of groups of the image
            "pages": In(binning.PAGE_BITS),  # pages of list memory
            # no more entries come: all groups are flushed and output in order; the next frame
            # begins when it is low again
            "finish": In(1),
            # bursts in pages beyond the last one are dropped
            "bursts": Out(stream_of(binning.burst_record(config))),
            "groups": Out(stream_of(binning.group_record())),
            # pages taken so far in the frame, until the next one begins; saturates
            "needed": Out(binning.PAGE_BITS),
            "exceeded": Out(1),  # `needed` is above `pages`, until the next frame begins
            "empty": Out(1),  # no entry is inside
            "taking": Out(1),  # entries are accepted
            "done": Out(1),  # all groups have been output
        }
        super().__init__(ports)
        self.state = Signal(State)
        self.group = Signal(range(self.count))
        self.flushed = Signal()
        self.full = Signal()
        self.same = Signal()
        self.had_burst = Signal()
        self.had_group = Signal()
        self.held = Signal(layout(binning.bin_entry_record(config)), reset_less=True)

    def elaborate(self, platform) -> Module:
        m = Module()
        state, group = self.state, self.group
        # An entry, or a group to flush, is being handled; it is done in this cycle.
        full, through = self.full, Signal()
        held, flushed = self.held, self.flushed
        free = ~full | through
        take, flush = Signal(), Signal()
        last = group + 1 == self.groups_count
        m.d.comb += [
            self.taking.eq(state == State.TAKE),
            self.done.eq(state == State.DONE),
            self.empty.eq(~full),
            self.i.ready.eq(self.taking & free),
            take.eq(self.i.valid & self.i.ready),
            flush.eq((state == State.FLUSH) & free & ~flushed),
        ]
        with m.If(free):
            m.d.sync += [full.eq(take | flush), held.eq(self.i.payload)]
        with m.If(flush):
            m.d.sync += [held.group.eq(group), group.eq(group + 1), flushed.eq(last)]
        with m.Switch(state):
            with m.Case(State.CLEAR):
                m.d.sync += group.eq(group + 1)
                with m.If(group == self.count - 1):
                    m.d.sync += [state.eq(State.TAKE), group.eq(0)]
            with m.Case(State.TAKE), m.If(self.finish & free & ~self.i.valid):
                m.d.sync += state.eq(State.FLUSH)
            with m.Case(State.FLUSH), m.If(flushed & through):
                m.d.sync += state.eq(State.DONE)
            with m.Case(State.DONE):
                m.d.sync += [flushed.eq(0), group.eq(0)]
                with m.If(~self.finish):
                    m.d.sync += [state.eq(State.TAKE), self.needed.eq(0), self.exceeded.eq(0)]

        asked = Mux(state == State.FLUSH, group, self.i.payload.group)
        flushing = state == State.FLUSH
        table, buffers, write_row, write_entry = self._memories(m, asked, take | flush, held.group)
        row, slots = self._present(m, table, buffers, held, free, through, take)
        self._handle(m, row, slots, held.entry, full, through, flushing, write_row, write_entry)
        with m.If(state == State.CLEAR):
            m.d.comb += [write_row.en.eq(1), write_row.addr.eq(group)]
        return m

    def _memories(self, m: Module, asked: Value, ask: Value, group: Value):
        """The table and the write buffers, one memory per slot of a buffer."""
        m.submodules.table = memory = Memory(shape=self.row, depth=self.count, init=[])
        write_row, read_row = memory.write_port(), memory.read_port()
        m.d.comb += [read_row.en.eq(ask), read_row.addr.eq(asked), write_row.addr.eq(group)]
        buffers, write_entry = [], []
        for k in range(self.burst - 1):
            memory = Memory(shape=entry_record(self.config).width, depth=self.count, init=[])
            m.submodules[f"buffer{k}"] = memory
            port, found = memory.write_port(), memory.read_port()
            m.d.comb += [found.en.eq(ask), found.addr.eq(asked), port.addr.eq(group)]
            buffers.append(found.data)
            write_entry.append(port)
        return read_row.data, buffers, write_row, write_entry

    def _present(self, m: Module, table, buffers, held, free: Value, through: Value, take: Value):
        """The group's row and buffer, as updated by the entry just before."""
        same, slot = self.same, Signal(range(self.burst))
        entry = Signal(entry_record(self.config).width, reset_less=True)
        self.new, self.slot = Signal(self.row), Signal(range(self.burst))
        new = Signal(self.row, reset_less=True)
        with m.If(through):
            m.d.sync += [new.eq(self.new), slot.eq(self.slot), entry.eq(held.entry)]
        with m.If(free):
            m.d.sync += same.eq(take & through & (held.group == self.i.payload.group))
        row = Signal(self.row)
        m.d.comb += row.eq(Mux(same, new, table))
        slots = [Mux(same & (slot == k), entry, found) for k, found in enumerate(buffers)]
        return row, slots

    def _handle(
        self, m: Module, row, slots, entry, full, through, flushing, write_row, write_entry
    ):
        """Handle an entry, or with `flushing` the end of a group."""
        burst_bits = exact_log2(self.burst)
        offset, bursts, groups = row.position[:burst_bits], self.bursts, self.groups
        logic = self.config.logic
        # In a page in use positions start at 1, behind the entry that took the page.
        page_full, fresh = row.position.all(), row.position == 0
        turn = page_full | fresh
        whole = Mux(flushing, offset != 0, offset.all())
        written = whole & row.inside
        m.d.comb += bursts.payload.address.eq(Cat(row.position[burst_bits:], row.page))
        m.d.comb += groups.payload.page.eq(Mux(fresh, 0, row.first))
        m.d.comb += groups.payload.count.eq(row.count)
        for k, slot in enumerate(slots):
            m.d.comb += bursts.payload.slots[k].eq(Mux(flushing & (offset <= k), 0, slot))
        inside = self.needed < self.pages
        final = Mux(page_full, self.needed, Value.cast(entry))
        m.d.comb += bursts.payload.slots[self.burst - 1].eq(Mux(flushing, 0, final))

        had_burst, had_group = self.had_burst, self.had_group
        m.d.comb += [
            bursts.valid.eq(full & written & ~had_burst),
            groups.valid.eq(full & flushing & ~had_group),
            through.eq(
                full
                & (~written | had_burst | bursts.ready)
                & (~flushing | had_group | groups.ready)
            ),
        ]
        m.d.sync += had_burst.eq(~through & (had_burst | (bursts.valid & bursts.ready)))
        m.d.sync += had_group.eq(~through & (had_group | (groups.valid & groups.ready)))
        m.d.comb += [
            self.new.page.eq(Mux(turn, self.needed, row.page)),
            self.new.inside.eq(Mux(turn, inside, row.inside)),
            self.new.position.eq(Mux(turn, 1, plus_one(row.position, logic))),
            self.new.first.eq(Mux(fresh, self.needed, row.first)),
            self.new.count.eq(plus_one(row.count, logic)),
            self.slot.eq(Mux(turn, 0, offset)),
            write_row.en.eq(through),
            write_row.data.eq(Mux(self.taking, Value.cast(self.new), 0)),
        ]
        with m.If(through & ~flushing & turn):
            m.d.sync += self.needed.eq(self.needed + ~self.needed.all())
            with m.If(~inside):
                m.d.sync += self.exceeded.eq(1)
        for k, port in enumerate(write_entry):
            m.d.comb += [port.data.eq(entry), port.en.eq(through & ~flushing & (self.slot == k))]
