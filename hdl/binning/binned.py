"""Writes the results of binning to memory: features, list pages, and the table of groups."""

from amaranth.hdl import Cat, Module, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.holds import enough
from splatcore.hdl.lib.record import AREA, stream_of
from splatcore.hdl.memory.store import Store
from splatcore.hdl.memory.write_combiner import WriteCombiner
from splatcore.spec.axi import BEAT, write_record
from splatcore.spec.binning import burst_record, group_record, groups_max
from splatcore.spec.config import Config
from splatcore.spec.feature import feature_record
from splatcore.spec.group import SPLAT_BITS
from splatcore.spec.work import FEATURE, SLOT

WRITING = ("features", "lists", "groups")
"""Names of its writers in `spec.axi.WRITERS`, in that order."""


class Binned(wiring.Component):
    """Writes a frame's work area.

    **Timing**: two features in three cycles, a burst in one cycle per beat of the port, a group in
    one cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        enough(8 * FEATURE, feature_record(config).width, "FEATURE, bits of a splat's features")
        ports = {
            "clear": In(1),  # a frame begins
            "features": In(stream_of(feature_record(config))),
            "bursts": In(stream_of(burst_record(config))),
            "groups": In(stream_of(group_record())),
            "area": In(AREA),  # the work area
            "features_max": In(SPLAT_BITS),  # number of features for which there is room
            "exceeded": Out(1),  # there were more features, which were dropped
            "finish": In(1),  # no more items come
            "empty": Out(1),  # nothing is inside
            # to memory, one for each of `WRITING`
            "writes": Out(stream_of(write_record(config))).array(len(WRITING)),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        features, groups = self._features(m), self._groups(m)
        self._lists(m)
        m.d.comb += self.empty.eq(features.empty & groups.empty)
        return m

    def _features(self, m: Module) -> WriteCombiner:
        m.submodules.features = line = WriteCombiner(self.config, FEATURE)
        connect(m, line.writes, flipped(self.writes[WRITING.index("features")]))
        number, i = Signal(SPLAT_BITS), self.features
        room = number != self.features_max
        m.d.comb += [
            line.i.valid.eq(i.valid & room),
            line.i.payload.slot.eq(self.area.features + number),
            line.i.payload.data.eq(i.payload.as_value()),
            line.flush.eq(self.finish),
            i.ready.eq(line.i.ready | ~room),
        ]
        with m.If(i.valid & i.ready):
            with m.If(room):
                m.d.sync += number.eq(number + 1)
            with m.Else():
                m.d.sync += self.exceeded.eq(1)
        with m.If(self.clear):
            m.d.sync += [number.eq(0), self.exceeded.eq(0)]
        return line

    def _lists(self, m: Module):
        beats = self.config.burst * SLOT // BEAT
        m.submodules.lists = store = Store(self.config, beats)
        connect(m, store.writes, flipped(self.writes[WRITING.index("lists")]))
        burst = self.bursts.payload
        m.d.comb += store.i.valid.eq(self.bursts.valid)
        m.d.comb += store.i.payload.beat.eq(self.area.lists + burst.address * beats)
        m.d.comb += [store.i.payload.data.eq(Cat(burst.slots)), self.bursts.ready.eq(store.i.ready)]

    def _groups(self, m: Module) -> WriteCombiner:
        m.submodules.groups = line = WriteCombiner(self.config, SLOT)
        connect(m, line.writes, flipped(self.writes[WRITING.index("groups")]))
        number, i = Signal(range(groups_max(self.config) + 1)), self.groups
        m.d.comb += [
            line.i.valid.eq(i.valid),
            line.i.payload.slot.eq(Cat(0, self.area.groups) + number),
            line.i.payload.data.eq(i.payload.as_value()),
            i.ready.eq(line.i.ready),
            line.flush.eq(self.finish),
        ]
        with m.If(i.valid & i.ready):
            m.d.sync += number.eq(number + 1)
        with m.If(self.clear):
            m.d.sync += number.eq(0)
        return line
