"""Second half of a frame: turns groups' lists and splats' features into pixels in memory."""

from amaranth.hdl import Cat, Module
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.lib.stream import Register, Slot
from splatcore.hdl.memory.axi import read_beat
from splatcore.hdl.memory.store import Store
from splatcore.hdl.memory.window import client_windows
from splatcore.hdl.raster.features import Features
from splatcore.hdl.raster.groups import Groups
from splatcore.hdl.raster.job import READING, WRITING, job_layout
from splatcore.hdl.raster.list_reader import LONG_BEATS_WAITING, LONG_BURST, ListReader
from splatcore.hdl.raster.pixels import Pixels
from splatcore.hdl.raster.raster import Raster
from splatcore.hdl.sorting.deal import Deal
from splatcore.hdl.sorting.sort import Sort
from splatcore.spec import axi
from splatcore.spec.config import Config


class Render(wiring.Component):
    """Stages 2 and 3 with their memory access, frame by frame.

    **Timing**: as its slowest part, if memory keeps up; a few hundred cycles more before the first
    pair and after the last.
    """

    def __init__(self, config: Config):
        self.config = config
        self.groups, self.deal, self.sort = Groups(config), Deal(config), Sort(config)
        self.long_lists = ListReader(config, LONG_BEATS_WAITING, LONG_BURST)
        self.lists = ListReader(config)
        self.buckets, self.features = Store(config, axi.LINE_BEATS), Features(config)
        self.raster, self.pixels = Raster(config), Pixels(config)
        parts = {"sort": self.sort, "raster": self.raster}
        counters = {name: part.counters.shape() for name, part in parts.items()}
        ports = {
            "start": In(1),  # begin a frame
            "job": In(job_layout(config)),  # its parameters, stable until `done`
            # to memory, one for each of `READING`
            "reads": Out(stream_of(axi.read_record())).array(len(READING)),
            # from memory, one for each of `READING`
            "data": In(stream.Signature(read_beat(config))).array(len(READING)),
            # to memory, one for each of `WRITING`
            "writes": Out(stream_of(axi.write_record(config))).array(len(WRITING)),
            # one bit for each of `WRITING`: all its written data is in memory
            "settled": In(len(WRITING)),
            # one bit for each of `WRITING`: its writes may wait for all others
            "patient": Out(len(WRITING)),
            "done": Out(1),  # the frame's pixels are in memory
            # counters of `hdl.sorting.sort` and `hdl.raster.raster`
            "counters": Out(data.StructLayout(counters)),
        }
        # `read_windows` and `write_windows` of `reads` and `writes`, if there are windows
        windows = client_windows(config, len(READING), len(WRITING))
        super().__init__(ports | {name: Out(shape) for name, shape in windows.items()})

    def elaborate(self, platform) -> Module:
        m = Module()
        groups, deal, sort, raster = self.groups, self.deal, self.sort, self.raster
        for name in ("groups", "deal", "sort", "long_lists", "lists", "buckets", "features"):
            m.submodules[name] = getattr(self, name)
        m.submodules.raster, m.submodules.pixels = raster, self.pixels
        for number, name in enumerate(READING):
            part = getattr(self, name)
            connect(m, part.reads, flipped(self.reads[number]))
            connect(m, flipped(self.data[number]), part.data)
        for number, name in enumerate(WRITING):
            connect(m, getattr(self, name).writes, flipped(self.writes[number]))
        m.submodules.entries = entries = Register(deal.entries.payload.shape())
        for source, target in (
            (groups.lists, deal.groups),
            (self.long_lists.o, entries.i),
            (entries.o, deal.entries),
            (deal.jobs, sort.jobs),
            (deal.lists, self.lists.i),
            (groups.positions, raster.positions),
            (groups.pixels, self.pixels.positions),
            (groups.empty, self.pixels.empty),
            (self.lists.o, sort.entries),
            (sort.o, self.features.i),
            (self.features.o, raster.i),
            *zip(raster.o, self.pixels.i, strict=True),
        ):
            connect(m, source, target)
        m.d.comb += [self.features.live.eq(raster.live), sort.stop.eq(self.features.stop)]
        self._deal(m)
        self._job(m)
        if axi.window_bits(self.config):
            self._windows(m)
        self._control(m)
        return m

    def _deal(self, m: Module):
        """Long lists from memory to dealing, and their buckets to memory."""
        deal, lists = self.deal, self.long_lists
        m.submodules.line = waiting = Slot(deal.lines.payload.shape())  # dealing goes on
        line = waiting.o.payload
        connect(m, deal.lines, waiting.i)
        m.d.comb += [
            deal.released.eq(self.sort.released),
            deal.settled.eq(~waiting.o.valid & self.settled[WRITING.index("buckets")]),
            lists.i.valid.eq(deal.reading.valid),
            lists.i.payload.page.eq(deal.reading.payload.page),
            lists.i.payload.count.eq(deal.reading.payload.count),
            deal.reading.ready.eq(lists.i.ready),
            self.buckets.i.valid.eq(waiting.o.valid),
            self.buckets.i.payload.beat.eq(self.job.scratch + line.address * axi.LINE_BEATS),
            self.buckets.i.payload.data.eq(Cat(line.slots)),
            waiting.o.ready.eq(self.buckets.i.ready),
        ]

    def _job(self, m: Module):
        """Parameters of the frame to the parts that use them."""
        job = self.job
        m.d.comb += [part.job.eq(job) for part in (self.groups, self.raster, self.pixels)]
        m.d.comb += [
            self.long_lists.lists_at.eq(job.area.lists),
            self.lists.lists_at.eq(job.area.lists),
            self.lists.scratch_at.eq(job.scratch),
            self.features.features_at.eq(job.area.features),
            self.pixels.groups.eq(self.groups.groups),
            self.patient[WRITING.index("pixels")].eq(self.pixels.plain),
            self.counters.sort.eq(self.sort.counters),
            self.counters.raster.eq(self.raster.counters),
        ]

    def _windows(self, m: Module):
        """The window of each reader and writer."""
        windows = self.job.windows
        for number, name in enumerate(READING):
            m.d.comb += self.read_windows[number].eq(windows[axi.READ_AREAS[name]])
        for number, name in enumerate(WRITING):
            m.d.comb += self.write_windows[number].eq(windows[axi.WRITE_AREAS[name]])
        with m.If(self.lists.in_scratch):
            m.d.comb += self.read_windows[READING.index("lists")].eq(windows.scratch)

    def _control(self, m: Module):
        """A frame from its start to its last pixel."""
        for part in (self.sort, self.raster):
            m.d.comb += part.clear.eq(self.start)
        for part in (self.groups, self.pixels):
            m.d.comb += part.start.eq(self.start)
        with m.FSM():
            with m.State("IDLE"), m.If(self.start):
                m.next = "GROUPS"
            with m.State("GROUPS"), m.If(self.pixels.through):
                m.next = "SETTLE"
            with m.State("SETTLE"):
                # `settled` does not include a beat that is offered and not taken.
                offered = self.pixels.writes.valid
                m.d.comb += self.done.eq(self.settled.all() & ~offered & ~self.groups.busy)
                with m.If(self.done):
                    m.next = "IDLE"
