"""Stage 3 connected: the sorted splats of each group to 8-bit pixels."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.counters import count_events, counters_layout
from splatcore.hdl.lib.credit import within
from splatcore.hdl.lib.holds import enough, keeps
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.shift import encoded, lowest
from splatcore.hdl.lib.stream import Fork, Pipe, Queue, Register, passes
from splatcore.hdl.raster.job import job_layout
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.prepare import CUTS, Prepare
from splatcore.hdl.raster.quads import SHARE
from splatcore.hdl.raster.rasterizer import PAIRS_WAITING, Rasterizer
from splatcore.hdl.raster.setup import Setup
from splatcore.hdl.raster.shared import Feeder, share_lanes
from splatcore.spec import counters, raster
from splatcore.spec.config import Config

SPLATS_WAITING = 16
"""Splats that may wait before stage 3: dead ones are dropped while others have many tiles."""

GROUPS_APART = (1 << raster.GROUP_BITS) - 1
"""Maximum number of groups by which the entering group is ahead of a rasterizer's."""


class Expand(wiring.Component):
    """Stage 3, second step: a pair for each tile of a splat that has live pixels, and a group's
    end.

    **Timing**: one pair per cycle; a splat without live tiles takes one cycle. No registers except
    for the tiles done and the tile offered.
    """

    def __init__(self, config: Config):
        self.config = config
        ports = {
            "i": In(stream_of(raster.readied_record(config))),
            # one per group, taken with the group's end
            "positions": In(stream_of(raster.position_record(config))),
            "live": In(config.group**2),  # the group's tiles that have live pixels
            # a waiting pair stays, even if its tile has ended meanwhile
            "o": Out(stream_of(raster.pair_record(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        side = self.config.group
        i, o, position = self.i.payload, self.o.payload, self.positions.payload
        done = Signal(side**2)
        open_tiles, chosen = Signal(side**2), Signal(side**2)
        waits = Signal(side**2)  # the tile whose pair was offered and not yet taken
        m.d.sync += waits.eq(Mux(self.o.valid & ~self.o.ready, chosen, 0))
        valid = self.i.valid & self.positions.valid
        m.d.comb += [
            open_tiles.eq((i.mask & self.live & ~done) | waits),
            chosen.eq(Mux(waits.any(), waits, lowest(open_tiles))),
            self.o.valid.eq(valid & (i.end | open_tiles.any())),
            self.i.ready.eq(
                valid & Mux(self.o.valid, self.o.ready & (i.end | (open_tiles == chosen)), 1)
            ),
            self.positions.ready.eq(self.i.ready & i.end),
            o.splat.eq(i.splat),
            o.end.eq(i.end),
            o.tile.eq(encoded(chosen)),
        ]
        columns = [Cat(chosen[row * side + k] for row in range(side)).any() for k in range(side)]
        rows = [chosen[row * side : (row + 1) * side].any() for row in range(side)]
        m.d.comb += o.column.eq(position.column * side + encoded(Cat(columns)))
        m.d.comb += o.row.eq(position.row * side + encoded(Cat(rows)))
        with m.If(self.i.ready):
            m.d.sync += done.eq(0)
        with m.Elif(self.o.valid & self.o.ready):
            m.d.sync += done.eq(done | chosen)
        return m


def counted(config: Config) -> tuple[str, ...]:
    """Names of the counters."""
    return tuple(counters.raster(config))


class Raster(wiring.Component):
    """Blends each group's splats in the order in which they come.

    Internal:
        splats: the queue of splats
        rasterizers: the rasterizers

    **Timing**: one pair per cycle; see also `hdl.raster.rasterizer`.
    """

    def __init__(self, config: Config):
        self.config = config
        # Ends of groups in between: in the queue, in the two pipes, in the register behind them and
        # before the rasterizer; and the group whose predecessor has ended but which has not begun.
        pipes = len(CUTS) + Setup.LATENCY + Mark.LATENCY
        inside = SPLATS_WAITING + pipes + Register.HOLDS + PAIRS_WAITING
        enough(GROUPS_APART, inside + 1, "GROUP_BITS, ends of groups that may be apart")
        self.dropped = Signal()
        self.splats = Queue(layout(raster.featured_record(config)), SPLATS_WAITING, memory=True)
        kind = Feeder if config.lanes == "quads" else Rasterizer
        self.rasterizers = [kind(config, number) for number in range(config.rasterizers)]
        ports = {
            # a group's splats front to back, then its end
            "i": In(stream_of(raster.featured_record(config))),
            # the groups' positions in their order
            "positions": In(stream_of(raster.position_record(config))),
            "job": In(job_layout(config)),
            # tiles of the group at `i` that have live pixels; splats of others are not needed
            "live": Out(config.group**2),
            # one per rasterizer: blocks within the image, group after group, each once
            "o": Out(stream_of(raster.pixels_record(config))).array(config.rasterizers),
            "clear": In(1),  # all counters are 0
            # counts of `counted`: splats taken; those without a live tile; pairs of a splat and a
            # tile; pairs without a marked block; cycles in which a pair waited
            "counters": Out(counters_layout(counted(config))),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        config = self.config
        m.submodules.prepare = self.prepare = Prepare(config)
        m.submodules.expand = self.expand = Expand(config)
        fork = Fork(layout(raster.position_record(config)), config.rasterizers + 1)
        m.submodules.positions = fork
        connect(m, self.prepare.o, self.expand.i)
        connect(m, flipped(self).positions, fork.i)
        self._register(m, "expand_position", fork.o[-1], self.expand.positions)
        for number, part in enumerate(self.rasterizers):
            m.submodules[f"rasterizer{number}"] = part
            self._register(m, f"position{number}", fork.o[number], part.positions)
            m.d.comb += part.job.eq(self.job)
            connect(m, part.o, flipped(self.o[number]))
        if config.lanes == "quads":
            half = config.rasterizers // SHARE
            for number in range(half):
                share_lanes(m, f"lanes{number}", self.rasterizers[number::half])
        self._admit(m)
        o = self.expand.o
        ends = o.valid & o.ready & o.payload.end
        m.d.comb += self.expand.live.eq(self._live(m, "expanded", ends))
        keeps(m, "pair", o)
        self._mark(m)
        self._count(m)
        return m

    def _register(self, m: Module, name: str, source, target):
        """Pass a group's position through a register, so that each taker has its own pace."""
        m.submodules[name] = register = Register(layout(raster.position_record(self.config)))
        connect(m, source, register.i)
        connect(m, register.o, target)

    def _mark(self, m: Module):
        """Pairs through setup and marking; each rasterizer gets the pairs with its own blocks."""
        config = self.config
        m.submodules.setup, m.submodules.mark = setup, mark = Setup(config), Mark(config)
        m.submodules.pipe = pipe = Pipe(Setup.LATENCY + Mark.LATENCY)
        m.d.comb += [
            pipe.i.valid.eq(self.expand.o.valid),
            self.expand.o.ready.eq(pipe.i.ready),
            setup.i.eq(self.expand.o.payload),
            mark.i.eq(setup.o),
            setup.enable.eq(pipe.loads[: Setup.LATENCY]),
            mark.enable.eq(pipe.loads[Setup.LATENCY :]),
        ]
        m.submodules.marked = register = Register(mark.o.shape())
        m.d.comb += [
            register.i.payload.eq(mark.o),
            register.i.valid.eq(pipe.o.valid),
            pipe.o.ready.eq(register.i.ready),
        ]
        self.marked, self.reached = register.o, Signal(config.rasterizers)
        marked, pair = register.o, register.o.payload
        self.arrived = Signal(raster.GROUP_BITS)  # number of the group whose pairs arrive
        with m.If(passes(marked) & pair.end):
            m.d.sync += self.arrived.eq(self.arrived + 1)
        takers = []
        # Rasterizers to which the last pair is, or was, offered; rasterizers that have taken it.
        offered, given = Signal(config.rasterizers), Signal(config.rasterizers)
        for number, part in enumerate(self.rasterizers):
            o = part.i.payload
            own = [Cat(level[block] for block in part.own) for level in pair.blocks]
            at_group = self._at(part, self.arrived)
            blocks = Mux(at_group, part.wanted(own, pair.tile), own[0])
            m.d.comb += [
                o[name].eq(pair[name]) for name in ("quadratic", "tile", "end", *raster.COLOURS)
            ]
            m.d.comb += o.blocks.as_value().eq(Cat(own))
            m.d.comb += self.reached[number].eq(blocks.any() | pair.end | offered[number])
            m.d.comb += part.i.valid.eq(marked.valid & self.reached[number] & ~given[number])
            keeps(m, f"marked{number}", part.i)
            takers.append(part.i.ready | ~self.reached[number] | given[number])
        m.d.comb += marked.ready.eq(Cat(takers).all())
        stays, taken = marked.valid & ~marked.ready, Cat(passes(p.i) for p in self.rasterizers)
        m.d.sync += offered.eq(Mux(stays, self.reached, 0))
        m.d.sync += given.eq(Mux(stays, given | taken, 0))

    def _at(self, part: Rasterizer, group: Signal):
        """High if a rasterizer is at a group, so that its live blocks are the group's."""
        return part.started & (part.group == group)

    def _admit(self, m: Module):
        """Splats wait in a queue, unless none of their tiles has a live pixel."""
        i = self.i.payload
        m.submodules.splats = queue = self.splats
        ends = passes(self.i) & i.end
        live = self._live(m, "entering", ends)
        for number, part in enumerate(self.rasterizers):
            within(
                m, f"groups{number}", ends, passes(part.positions), GROUPS_APART,
                "groups apart, too many for GROUP_BITS", begin=1,
            )  # fmt: skip
        m.d.comb += [
            self.live.eq(live),
            self.dropped.eq(self.i.valid & ~i.end & ~(i.mask & live).any()),
            queue.i.payload.eq(i),
            queue.i.valid.eq(self.i.valid & ~self.dropped),
            self.i.ready.eq(queue.i.ready | self.dropped),
        ]
        connect(m, queue.o, self.prepare.i)

    def _live(self, m: Module, name: str, ends: Value) -> Signal:
        """Tiles with live pixels, as far as known, of the group at one place of the pipeline.

        The tiles are registered: within a group they only lose pixels, so the previous cycle's are
        safe, except for the next group.

        ends: a group's end passes that place
        """
        tiles = self.config.group**2
        group, live = Signal(raster.GROUP_BITS, name=name), Signal(tiles, init=(1 << tiles) - 1)
        with m.If(ends):
            m.d.sync += group.eq(group + 1)
        behind = ~Cat(self._at(part, group) for part in self.rasterizers).all()
        for tile in range(tiles):
            blocks = Cat(part.live[tile] for part in self.rasterizers)
            m.d.sync += live[tile].eq(blocks.any() | behind | ends)
        return live

    def _count(self, m: Module):
        o, i = self.expand.o, self.i
        arrives = passes(self.marked) & ~self.marked.payload.end
        events = {
            "splats": i.valid & i.ready & ~i.payload.end,
            "dropped": self.dropped & self.i.ready,
            "pairs": o.valid & o.ready & ~o.payload.end,
            "empty": arrives & ~self.reached.any(),
            "blocked": o.valid & ~o.ready,
        }
        for number, part in enumerate(self.rasterizers):
            events |= {f"{name}{number}": getattr(part, name) for name in counters.RASTERIZER}
        count_events(m, self, events)
