"""Stages 0 and 1 connected: chunk headers, positions and attributes to splats."""

from amaranth.hdl import Module, Value
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.arithmetic.compare import compared
from splatcore.hdl.lib.counters import count_events, counters_layout
from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Fork, Queue, Slot, passes
from splatcore.hdl.points.array import codes
from splatcore.hdl.points.chunk import Chunk
from splatcore.hdl.points.cull import Cull
from splatcore.hdl.points.place import Place
from splatcore.hdl.points.project import Project
from splatcore.spec.config import Config
from splatcore.spec.counters import POINTS
from splatcore.spec.microprogram import constants
from splatcore.spec.point import FETCH, chunk_record, splat_record

COUNTED = tuple(POINTS)

CHUNKS_WAITING = 2
"""Chunks that may wait before each part, so that the next one is ready when a chunk is done."""

CHUNKS_INSIDE = 4 * CHUNKS_WAITING
"""More chunks than can be between the first part and the last: no queue holds more than
`CHUNKS_WAITING`, the fork one, and the slot before the last part one."""


class Front(wiring.Component):
    """End of stage 1 in a machine without culling: passes on splats whose centre is in front.

    With culling (`Config.culling`) all centres are in front, and there is no such part.

    Members:
        i: in, stream of `splat_record`
        near_plane: in, register of the frame
        o: out, stream of `splat_record`

    **Timing**: combinational; one splat per cycle.
    """

    def __init__(self, config: Config):
        self.config = config
        splats = stream.Signature(layout(splat_record(config)))
        ports = {"i": In(splats), "near_plane": In(config.arithmetic.width), "o": Out(splats)}
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        format = self.config.arithmetic
        compare = compared(m, "compare", format, self.near_plane, self.i.payload.z)
        m.d.comb += self.o.payload.eq(self.i.payload)
        m.d.comb += self.o.valid.eq(self.i.valid & compare.less)
        m.d.comb += self.i.ready.eq(self.o.ready | ~compare.less)
        return m


class Points(wiring.Component):
    """Stages 0 and 1: turns chunk headers, positions and attributes into splats.

    Members:
        headers: in, stream of `CHUNK_HEADER`, the whole model's headers for each frame
        fetch: out, stream of `FETCH`, chunks whose positions are to be read
        positions: in, stream of the beats of these positions
        wanted: out, stream of `WANTED`, Gaussians whose attributes are to be read
        attributes: in, stream of the beats of these attributes
        near_plane, camera, constants: in, registers of the frame
        splats: out, stream of `splat_record`, in the order of the model
        idle: out, no chunk and no splat is inside; if the last header is taken, the frame is done
        clear: in, all counters are 0
        counters: out, counts of `COUNTED`; the last three count rounds of the projection's array
            that began with a Gaussian, without one, and without one because splats were not taken
        gaussians, position_exponent, exponent: in, from the model's header; stable for a frame
        write: in, stream of {address, word}, words of the codebook memory, before the frame
        sh: in, only if the machine has harmonics: the model has harmonics
        codebooks: in, only if `Config.colours` is not `array`: the model has codebooks
        small: in, only if `Config.small_models`: the model has half a beat of attributes per
            Gaussian

    **Timing**: a point every 4 cycles (`hdl.points.cull`) and a splat every 6 in `DEFAULT`
    (`hdl.points.project`).
    """

    def __init__(self, config: Config):
        self.chunk, self.cull = Chunk(config), Cull(config)
        self.place, self.project = Place(config), Project(config)
        self.config = config
        chunk, project = self.chunk.signature.members, self.project.signature.members
        ports = {
            "headers": chunk["i"],
            "fetch": Out(stream.Signature(layout(FETCH))),
            "positions": self.cull.signature.members["positions"],
            "wanted": project["wanted"],
            "attributes": project["attributes"],
            "near_plane": In(config.arithmetic.width),
            "constants": In(codes(config, constants(config))),
            "splats": project["o"],
            "idle": Out(1),
            "clear": In(1),
            "counters": Out(counters_layout(COUNTED)),
        }
        ports |= {name: chunk[name] for name in ("gaussians", "camera", "position_exponent")}
        ports |= {name: project[name] for name in self.project.tables}
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.chunk, m.submodules.cull = self.chunk, self.cull
        m.submodules.place, m.submodules.project = self.place, self.project
        outside = flipped(self)
        connect(m, outside.headers, self.chunk.i)
        connect(m, outside.positions, self.cull.positions)
        connect(m, outside.wanted, self.project.wanted)
        connect(m, outside.attributes, self.project.attributes)
        self._splats(m, outside.splats)
        connect(m, self.cull.o, self.place.i)
        connect(m, self.place.o, self.project.i)
        self._chunks(m)
        self._registers(m)
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

    def _splats(self, m: Module, splats):
        """Output the splats; without culling, only splats in front."""
        if self.config.culling != "none":
            connect(m, splats, self.project.o)
            return
        m.submodules.front = front = Front(self.config)
        m.d.comb += front.near_plane.eq(self.near_plane)
        connect(m, self.project.o, front.i)
        connect(m, front.o, splats)

    def _registers(self, m: Module):
        """Registers of the frame and of the model to the parts that use them."""
        for part in (self.chunk, self.cull, self.place, self.project):
            for name in part.constants.shape().members:
                m.d.comb += part.constants[name].eq(self.constants[name])
        for part in (self.chunk, self.cull, self.place):
            m.d.comb += part.near_plane.eq(self.near_plane)
        m.d.comb += self.chunk.gaussians.eq(self.gaussians)
        for part in (self.chunk, self.cull):
            m.d.comb += part.camera.eq(self.camera)
            m.d.comb += part.position_exponent.eq(self.position_exponent)
        for name in self.project.tables:
            if name == "write":
                connect(m, flipped(self).write, self.project.write)
            else:
                m.d.comb += getattr(self.project, name).eq(getattr(self, name))
        if "small" in self.cull.signature.members:
            m.d.comb += self.cull.small.eq(self.small)

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
