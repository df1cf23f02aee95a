"""Stages 0 and 1 connected: chunk headers, positions and attributes to splats."""

from amaranth.hdl import Module, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.compare import compared
from splatcore.hdl.lib.counters import count_events, counters_layout
from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.stream import Fork, Queue, Slot, passes
from splatcore.hdl.points.chunk import Chunk
from splatcore.hdl.points.codebook import codebook_line
from splatcore.hdl.points.cull import Cull
from splatcore.hdl.points.level import level_ports
from splatcore.hdl.points.place import Place
from splatcore.hdl.points.project import Project
from splatcore.hdl.points.state import ModelState, frame_state
from splatcore.spec.config import Config
from splatcore.spec.counters import POINTS
from splatcore.spec.memory import ATTRIBUTE_BITS, CHUNK_HEADER
from splatcore.spec.point import FETCH, WANTED, chunk_record, splat_record

COUNTED = tuple(POINTS)

CHUNKS_WAITING = 2
"""Chunks that may wait before each part, so that the next one is ready when a chunk is done."""

CHUNKS_INSIDE = 4 * CHUNKS_WAITING
"""More chunks than can be between the first part and the last: no queue holds more than
`CHUNKS_WAITING`, the fork one, and the slot before the last part one."""


class Front(wiring.Component):
    """End of stage 1 in a machine without culling: passes on splats whose centre is in front.

    With culling (`Config.culling`) all centres are in front, and there is no such part.

    **Timing**: combinational; one splat per cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(stream_of(splat_record(config))),
            "frame": In(frame_state(config)),
            "o": Out(stream_of(splat_record(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.config.arithmetic
        compare = compared(m, "compare", format, self.frame.near_plane, self.i.payload.z)
        m.d.comb += self.o.payload.eq(self.i.payload)
        m.d.comb += self.o.valid.eq(self.i.valid & compare.less)
        m.d.comb += self.i.ready.eq(self.o.ready | ~compare.less)
        return m


class Points(wiring.Component):
    """Stages 0 and 1: turns chunk headers, positions and attributes into splats.

    **Timing**: a point every 4 cycles (`hdl.points.cull`) and a splat every 6 in `DEFAULT`
    (`hdl.points.project`).
    """

    def __init__(self, config: Config):
        self.chunk, self.cull = Chunk(config), Cull(config)
        self.place, self.project = Place(config), Project(config)
        self.config = config
        ports = {
            # the whole model's headers for each frame, with the records of its levels
            "headers": In(stream_of(CHUNK_HEADER)),
            "fetch": Out(stream_of(FETCH)),  # chunks whose positions are to be read
            "positions": In(stream.Signature(ATTRIBUTE_BITS)),  # the beats of these positions
            "wanted": Out(stream_of(WANTED)),  # Gaussians whose attributes are to be read
            "attributes": In(stream.Signature(ATTRIBUTE_BITS)),  # the beats of these attributes
            # {address, word}, words of the codebook memory, before the frame
            "write": In(stream.Signature(codebook_line(config))),
            "frame": In(frame_state(config)),
            "model": In(ModelState),
            "splats": Out(stream_of(splat_record(config))),  # in the order of the model
            # no chunk and no splat is inside; if the last header is taken, the frame is done
            "idle": Out(1),
            "clear": In(1),  # all counters are 0
            # counts of `COUNTED`; the last three count rounds of the projection's array that began
            # with a Gaussian, without one, and without one because splats were not taken
            "counters": Out(counters_layout(COUNTED)),
        }
        super().__init__(ports | level_ports(config.levels))

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.chunk, m.submodules.cull = self.chunk, self.cull
        m.submodules.place, m.submodules.project = self.place, self.project
        outside, chunk, cull, place, project = (
            flipped(self), self.chunk, self.cull, self.place, self.project
        )  # fmt: skip
        for source, target in (
            (outside.headers, chunk.i),
            (outside.positions, cull.positions),
            (cull.o, place.i),
            (place.o, project.i),
            (project.wanted, outside.wanted),
            (outside.attributes, project.attributes),
            (outside.write, project.write),
            (self._in_front(m), outside.splats),
        ):
            connect(m, source, target)
        m.d.comb += [part.frame.eq(self.frame) for part in (chunk, cull, place, project)]
        m.d.comb += [part.model.eq(self.model) for part in (chunk, cull, project)]
        if self.config.levels:
            m.d.comb += [chunk.levels.eq(self.levels), chunk.turn.eq(self.turn)]
            m.d.comb += [
                getattr(self, name).eq(getattr(chunk, name)) for name in ("fault", "jump", "target")
            ]
        self._chunks(m)
        self._idle(m)
        self._count(m)
        return m

    def _chunks(self, m: Module):
        """Send a chunk to the reader of its points and to all parts that handle them."""
        parts = {"culling": self.cull, "placing": self.place, "projecting": self.project}
        record = chunk_record(self.config)
        m.submodules.fork = fork = Fork(layout(record), len(parts) + 1)
        connect(m, self.chunk.o, fork.i)
        for (name, part), o in zip(parts.items(), fork.o, strict=False):
            queue = Queue(layout(record[name]), CHUNKS_WAITING)
            m.submodules[f"{name}_chunks"] = queue
            m.d.comb += [queue.i.payload.eq(o.payload[name]), queue.i.valid.eq(o.valid)]
            m.d.comb += o.ready.eq(queue.i.ready)
            source = queue.o
            if part is self.project:  # logic behind a chunk is slow
                m.submodules[f"{name}_chunk"] = slot = Slot(layout(record[name]))
                connect(m, queue.o, slot.i)
                source = slot.o
            connect(m, source, part.chunks)
        last = fork.o[len(parts)]
        m.d.comb += self.fetch.payload.eq(last.payload.fetch)
        m.d.comb += [self.fetch.valid.eq(last.valid), last.ready.eq(self.fetch.ready)]

    def _in_front(self, m: Module) -> stream.Interface:
        """The splats; without culling, only splats in front."""
        if self.config.culling != "none":
            return self.project.o
        m.submodules.front = front = Front(self.config)
        m.d.comb += front.frame.eq(self.frame)
        connect(m, self.project.o, front.i)
        return front.o

    def _idle(self, m: Module):
        """Count chunks from the first part to the last, and splats from slot to output."""
        project = self.project
        most = self.config.projection_slots + project.splats_inside
        m.submodules.chunks = chunks = Credit(CHUNKS_INSIDE, "chunks inside")
        m.submodules.splats = splats = Credit(most, "splats inside")
        m.d.comb += [
            chunks.comes.eq(passes(self.chunk.o)),
            chunks.goes.eq(passes(project.chunks)),
            splats.comes.eq(self._inside()),
            splats.goes.eq(passes(project.o)),
            self.idle.eq(~(chunks.any | splats.any)),
        ]

    def _inside(self) -> Value:
        """High if a point takes a slot."""
        placed = self.project.i
        return passes(placed) & placed.payload.kept

    def _count(self, m: Module):
        o = self.cull.o
        events = {
            "chunks": self.chunk.taken,
            "skipped": self.chunk.taken & ~self.chunk.o.valid,
            "points": self.cull.taken,
            "front": passes(o) & o.payload.kept,
            "inside": self._inside(),
            "projected": self.project.entered,
            "starved": self.project.starved,
            "blocked": self.project.blocked,
        }
        count_events(m, self, events)
