"""A cascade of merges that sorts passing batches of entries; each merge doubles the runs."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out
from amaranth.utils import exact_log2

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Queue
from splatcore.spec.config import Config
from splatcore.spec.sort import batch_record, index_bits, ranked_record

MEMORY_FROM = 8
"""Minimum length of runs that wait in memories; shorter runs wait in flip-flops."""

PAIRS_WAITING = 4  # pairs of runs in a merge whose first run is complete


def entry_layout(config: Config, size: int) -> data.StructLayout:
    """Layout of an entry of a run of `size`. index: in its run; last: of its batch."""
    key = batch_record(config)["key"].width
    return data.StructLayout({"key": key, "index": exact_log2(size), "last": 1})


def latency(size: int) -> int:
    """Cycles from the arrival of an entry at a merge of runs of `size` to its comparison."""
    return 2 if size >= MEMORY_FROM else 1


class Pair(wiring.Component):
    """Merges runs of `size` entries two by two; of equal keys the earlier entry comes first.

    A batch is cut into runs from its beginning; its last run may be shorter, and may be unpaired.

    Internal:
        turn: the run at `i` is the second of its pair
        count: entries of that run that have come
        over: for each run of the pair that leaves: it has left
        last: the second run ends its batch

    **Timing**: one entry per cycle; a run's first entry leaves `latency` cycles after the first
    entry of its pair's second run, or after the end of an unpaired run. Two queues of
    `size` entries and entries that come meanwhile. No multiplier; no path from `o.ready` to
    `i.ready`.
    """

    def __init__(self, config: Config, size: int):
        self.config, self.size = config, size
        entry, merged = entry_layout(config, size), entry_layout(config, 2 * size)
        ports = {
            "i": In(stream.Signature(entry)),  # of runs of `size`
            "o": Out(stream.Signature(merged)),  # of runs of 2 · `size`
        }
        super().__init__(ports)
        held = data.StructLayout({"entry": entry, "last": 1})  # last: of its run
        depth, memory = size + latency(size) + 1, size >= MEMORY_FROM
        self.runs = [Queue(held, depth, memory=memory) for _ in range(2)]
        self.alone = Queue(1, PAIRS_WAITING)  # for each pair: it has no second run
        self.turn = Signal()
        self.count = Signal(range(max(size, 2)))
        self.over = Signal(2)
        self.last = Signal()

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.first, m.submodules.second = self.runs
        m.submodules.alone = self.alone
        self._push(m)
        self._merge(m)
        return m

    def _push(self, m: Module):
        """Runs go to the two queues in turn."""
        i, turn, count = self.i, self.turn, self.count
        ends, known = Signal(), self.alone.i
        room = Mux(turn, self.runs[1].i.ready, self.runs[0].i.ready)
        m.d.comb += [
            ends.eq(i.payload.last | (count == self.size - 1)),
            i.ready.eq(room & known.ready),
            known.payload.eq(i.payload.last),
            known.valid.eq(i.valid & room & ~turn & ends),
        ]
        for number, run in enumerate(self.runs):
            m.d.comb += [
                run.i.valid.eq(i.valid & known.ready & (turn == number)),
                run.i.payload.entry.eq(i.payload),
                run.i.payload.last.eq(ends),
            ]
        with m.If(i.valid & i.ready):
            m.d.sync += count.eq(Mux(ends, 0, count + 1))
            with m.If(ends):
                m.d.sync += turn.eq(~turn & ~i.payload.last)

    def _merge(self, m: Module):
        """Output the smaller head of a pair whose first run has come."""
        o, pair = self.o, self.alone.o
        first, second = (run.o for run in self.runs)
        over, last = self.over, self.last
        left = Signal(2)  # a run has entries that have not left
        m.d.comb += [left[0].eq(~over[0]), left[1].eq(~over[1] & ~pair.payload)]
        less = Signal()
        m.d.comb += less.eq(second.payload.entry.key < first.payload.entry.key)
        chosen = Signal()  # the second run's
        m.d.comb += [
            chosen.eq(left[1] & (~left[0] | less)),
            o.valid.eq(pair.valid & (~left[0] | first.valid) & (~left[1] | second.valid)),
        ]
        for number, run in enumerate((first, second)):
            with m.If(chosen == number):
                m.d.comb += o.payload.key.eq(run.payload.entry.key)
                m.d.comb += o.payload.index.eq(Cat(run.payload.entry.index, chosen))
        taken = Signal()
        done = Mux(chosen, second.payload.last & ~left[0], first.payload.last & ~left[1])
        ends = pair.payload | Mux(chosen, second.payload.entry.last, last)
        m.d.comb += [
            taken.eq(o.valid & o.ready),
            first.ready.eq(taken & ~chosen),
            second.ready.eq(taken & chosen),
            pair.ready.eq(taken & done),
            o.payload.last.eq(done & ends),
        ]
        with m.If(taken & done):
            m.d.sync += over.eq(0)
        with m.Elif(taken):
            m.d.sync += over[0].eq(over[0] | (~chosen & first.payload.last))
            m.d.sync += over[1].eq(over[1] | (chosen & second.payload.last))
        with m.If(second.valid & second.ready):
            m.d.sync += last.eq(second.payload.entry.last)


class Cascade(wiring.Component):
    """Sorts batches of up to `Config.sub_sorter_entries` entries, stably.

    **Timing**: one entry per cycle in and out. The latency from a full batch's last entry in to its
    first entry out is the sum of all merges' latencies; shorter batches stay up to half a batch
    longer. Batches follow each other without a pause; several may be inside. Memory for two
    batches. No multiplier.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(stream_of(batch_record(config))),
            "o": Out(stream_of(ranked_record(config))),
        }
        super().__init__(ports)
        self.pairs = [Pair(config, 1 << k) for k in range(index_bits(config))]

    def elaborate(self, platform) -> Module:
        m = Module()
        streams = [self.i, *(pair.o for pair in self.pairs)]
        for before, pair in zip(streams, self.pairs, strict=False):
            m.submodules[f"pair{pair.size}"] = pair
            _join(m, before, pair.i)
        _join(m, streams[-1], self.o)
        return m


def _join(m: Module, source: stream.Interface, target: stream.Interface):
    """Connect key, last bit, and the index if the source has one."""
    m.d.comb += [target.valid.eq(source.valid), source.ready.eq(target.ready)]
    for name in source.payload.shape().members:
        m.d.comb += target.payload[name].eq(source.payload[name])
