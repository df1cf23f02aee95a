"""A sub-sorter whose entries carry the place their run is written to."""

from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.sorting.cascade import Cascade
from splatcore.hdl.sorting.subsort import SubSorter
from splatcore.spec.config import Config
from splatcore.spec.sort import batch_record, ranked_record

HALVES = 2

BATCHES_INSIDE = 4
"""Maximum number of batches in a cascade: two full ones, and short ones of small lists."""


def target_layout(config: Config) -> data.StructLayout:
    """The place where a run is written: a way of a half."""
    return data.StructLayout({"way": range(config.merge_ways), "half": 1})


class Sorter(wiring.Component):
    """Sorts batches into runs (`Config.sub_sorter`).

    Internal:
        part: the sub-sorter or cascade

    A cascade also has `begins` (the next entry begins a batch), `targets`, `inside` (batches of
    each half inside) and `drops` (how many of these are dropped), for proofs.

    **Timing**: as `hdl.sorting.subsort`, with one batch inside at a time, or as
    `hdl.sorting.cascade`, in which dropped entries travel to the end.
    """

    def __init__(self, config: Config):
        self.config = config
        given, found = layout(batch_record(config)), layout(ranked_record(config))
        target = target_layout(config)
        ports = {
            # {entry, to}: entries of batches (`batch_record`) and their target
            "i": In(stream.Signature(data.StructLayout({"entry": given, "to": target}))),
            # {entry, to}: entries of runs (`ranked_record`) and their target
            "o": Out(stream.Signature(data.StructLayout({"entry": found, "to": target}))),
            # one bit per half: its job is over, its entries inside are dropped
            "release": In(HALVES),
            "idle": Out(1),  # no entry is inside
        }
        super().__init__(ports)
        self.trees = config.sub_sorter == "trees"
        self.part = (SubSorter if self.trees else Cascade)(config)
        if not self.trees:
            self.begins = Signal(init=1)
            self.targets = Queue(target, BATCHES_INSIDE)
            counts = range(BATCHES_INSIDE + 1)
            self.inside = [Credit(BATCHES_INSIDE, f"batches of half {k}") for k in range(HALVES)]
            self.drops = [Signal(counts, name=f"drops{half}") for half in range(HALVES)]

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = self.part
        m.d.comb += [
            part.i.payload.eq(self.i.payload.entry),
            self.o.payload.entry.eq(part.o.payload),
        ]
        (self._one_batch if self.trees else self._batches)(m, part)
        return m

    def _one_batch(self, m: Module, part: SubSorter):
        """Entries that a sub-sorter still offers go to the target of the previous batch."""
        i, o, target = self.i, self.o, Signal(target_layout(self.config))
        m.d.comb += [
            part.i.valid.eq(i.valid & ~part.o.valid),
            i.ready.eq(part.i.ready & ~part.o.valid),
            o.valid.eq(part.o.valid),
            part.o.ready.eq(o.ready),
            o.payload.to.eq(target),
            self.idle.eq(part.idle),
            # An idle one must not drop: it may just be getting an entry of the next job.
            part.drop.eq(self.release.bit_select(target.half, 1) & ~part.idle),
        ]
        with m.If(i.valid & i.ready):
            m.d.sync += target.eq(i.payload.to)

    def _batches(self, m: Module, part: Cascade):
        """Batches leave in order; batches of a released half are dropped at the output."""
        i, o = self.i, self.o
        m.submodules.targets = targets = self.targets
        begins, stale, ends = self.begins, Signal(), Signal()
        enters = Signal()
        m.d.comb += [
            targets.i.payload.eq(i.payload.to),
            targets.i.valid.eq(i.valid & begins & part.i.ready),
            part.i.valid.eq(i.valid & (~begins | targets.i.ready)),
            i.ready.eq(part.i.ready & (~begins | targets.i.ready)),
            o.payload.to.eq(targets.o.payload),
            o.valid.eq(part.o.valid & ~stale),
            part.o.ready.eq(o.ready | stale),
            ends.eq(part.o.valid & part.o.ready & part.o.payload.last),
            targets.o.ready.eq(ends),
            enters.eq(targets.i.valid & targets.i.ready),
            self.idle.eq(~targets.o.valid),
        ]
        with m.If(i.valid & i.ready):
            m.d.sync += begins.eq(i.payload.entry.last)
        dropped = []
        for half, (inside, drops) in enumerate(zip(self.inside, self.drops, strict=True)):
            m.submodules[f"inside{half}"] = inside
            m.d.comb += [
                inside.comes.eq(enters & (i.payload.to.half == half)),
                inside.goes.eq(ends & (targets.o.payload.half == half)),
            ]
            with m.If(self.release[half]):
                m.d.sync += drops.eq(inside.count - inside.goes)
            with m.Elif(inside.goes & drops.any()):
                m.d.sync += drops.eq(drops - 1)
            dropped.append(drops.any())
        m.d.comb += stale.eq(Mux(targets.o.payload.half, dropped[1], dropped[0]))
