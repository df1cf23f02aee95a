"""Merges sorted runs into one: the smallest head first, of equal heads the earliest run's."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import layout
from splatcore.hdl.sorting.runs import slot_layout, word_read
from splatcore.hdl.sorting.subsort import lowest
from splatcore.spec.config import Config
from splatcore.spec.group import key_format
from splatcore.spec.sort import index_bits, ranked_record, way_bits


class Merge(wiring.Component):
    """Merges up to `Config.merge_ways` runs whose entries are, or will be, in a half.

    Two entries of each run are held, the head and the one behind it, which hides the time the
    memory takes to deliver the next entry. Heads are compared in a tree of comparators, cut in the
    middle by registers. (OR-trees pay off for many entries that are loaded once; here there are
    few, and a new one in every round.)

    **Timing**: one entry every `INTERVAL` cycles; the first one 5 cycles, and one cycle per run,
    after `begin`. No multiplier.
    """

    INTERVAL = 2  # minimum number of cycles from an entry to the next one

    def __init__(self, config: Config):
        self.config, self.ways = config, config.merge_ways
        self.counter = index_bits(config) + 1
        self.key_bits = key_format(config).width
        self.taken = data.StructLayout(
            {"valid": 1, "key": self.key_bits, "slot": slot_layout(config)}
        )
        ports = {
            # merge the runs in `runs`; their first entries are read as soon as they are written
            "begin": In(1),
            "runs": In(self.ways),  # one bit per way: it has a run, which is not empty
            # number of entries written, per run
            "written": In(data.ArrayLayout(self.counter, self.ways)),
            "head": Out(word_read(config)),  # an entry to be read
            # the entry that was to be read in the previous cycle
            "found": In(layout(ranked_record(config))),
            "room": In(1),  # the next entry may be output
            # {valid, key, slot}, the next entry for one cycle: its key, and the slot of its value
            "o": Out(self.taken),
            "stop": In(1),  # all runs are dropped
            "busy": Out(1),  # entries are left
            "starved": Out(1),  # no entry is output because a head is missing
            "blocked": Out(1),  # no entry is output because there is no room
        }
        super().__init__(ports)
        entry = layout(ranked_record(config))
        self.heads = [Signal(entry, name=f"head{k}", reset_less=True) for k in range(self.ways)]
        self.behind = [Signal(entry, name=f"behind{k}", reset_less=True) for k in range(self.ways)]
        self.live, self.present = Signal(self.ways), Signal(self.ways)
        self.waits, self.ended = Signal(self.ways), Signal(self.ways)

    def elaborate(self, platform) -> Module:
        m = Module()
        # Half of the tree is evaluated in the first cycle of a round, the rest in the second; heads
        # stay until the round ends, so the registers between may always load.
        second, all_present, takes = Signal(), Signal(), Signal(self.ways)
        winner = self._compare(m)
        m.d.comb += [
            self.busy.eq(self.live.any()),
            all_present.eq((~self.live | self.present).all() & self.busy),
            self.o.valid.eq(second & self.room),
            self.o.key.eq(winner.key),
            self.o.slot.eq(winner.slot),
            takes.eq(Mux(self.o.valid, 1 << winner.slot.way, 0)),
            self.starved.eq(self.busy & ~second & ~all_present),
            self.blocked.eq(second & ~self.room),
        ]
        m.d.sync += second.eq(Mux(second, ~self.room, all_present))
        self._advance(m, takes, self._fetch(m))
        with m.If(self.begin):
            m.d.sync += [self.live.eq(self.runs), self.ended.eq(0)]
        with m.If(self.stop):
            m.d.sync += [signal.eq(0) for signal in (self.live, self.present, self.waits, second)]
        return m

    def _compare(self, m: Module) -> data.View:
        """The smallest head, of equal ones the earliest, in the second cycle of a round."""
        shape = data.StructLayout(
            {"key": self.key_bits, "gone": 1, "slot": slot_layout(self.config)}
        )
        level = []
        for way, head in enumerate(self.heads):
            leaf = Signal(shape, name=f"leaf{way}")
            m.d.comb += [leaf.key.eq(head.key), leaf.gone.eq(~self.live[way])]
            m.d.comb += [leaf.slot.index.eq(head.index), leaf.slot.way.eq(way)]
            level.append(leaf)
        levels = way_bits(self.config)
        for number in range(levels):
            joined, cut = [], number == levels // 2
            for k in range(0, len(level), 2):
                first, second = level[k : k + 2]
                node = Signal(shape, name=f"node{number}_{k}", reset_less=True)
                less = Cat(second.key, second.gone) < Cat(first.key, first.gone)
                m.d["sync" if cut else "comb"] += node.eq(Mux(less, second, first))
                joined.append(node)
            level = joined
        return level[0]

    def _fetch(self, m: Module) -> Signal:
        """Read one entry at a time, heads first; return one bit per way: its entry is here."""
        read = [Signal(self.counter, name=f"read{way}") for way in range(self.ways)]
        fetching, asked, able, headless = (Signal(self.ways) for _ in range(4))
        left = Cat(pointer != self.written[way] for way, pointer in enumerate(read))
        first = lowest(m, Mux(headless.any(), headless, able))
        m.d.comb += able.eq(self.live & ~self.ended & ~fetching & ~self.waits & left)
        m.d.comb += [headless.eq(able & ~self.present), asked.eq(first)]
        m.d.sync += fetching.eq(Mux(self.stop, 0, asked))
        m.d.comb += self.head.valid.eq(able.any())
        for way, pointer in enumerate(read):
            with m.If(asked[way]):
                m.d.comb += [self.head.slot.way.eq(way), self.head.slot.index.eq(pointer)]
                m.d.sync += pointer.eq(pointer + 1)
            with m.If(self.begin):
                m.d.sync += pointer.eq(0)
        return fetching

    def _advance(self, m: Module, takes: Signal, found: Signal):
        """A head that is taken is replaced by the entry behind it, or by the one just found."""
        for way, (head, behind) in enumerate(zip(self.heads, self.behind, strict=True)):
            arrives, present, waits = found[way], self.present[way], self.waits[way]
            with m.If(takes[way]):
                m.d.sync += [head.eq(Mux(waits, behind, self.found)), present.eq(waits | arrives)]
                m.d.sync += [waits.eq(waits & arrives), self.live[way].eq(~head.last)]
            with m.Elif(arrives):
                m.d.sync += [present.eq(1), waits.eq(present)]
                with m.If(~present):
                    m.d.sync += head.eq(self.found)
            with m.If(arrives):
                m.d.sync += [behind.eq(self.found), self.ended[way].eq(self.found.last)]
