"""Two rasterizers that share lanes: each issues and evaluates its own blocks."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import stream
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.raster.finished_quads import FinishedQuads, quad_layout
from splatcore.hdl.raster.quads import PHASE_BITS, Quad, operation_layout, quad_of
from splatcore.hdl.raster.rasterizer import Rasterizer
from splatcore.spec.config import Config
from splatcore.spec.quads import QUADS, ended_level, halvings_min, quad_pixels
from splatcore.spec.raster import block_count


class Feeder(Rasterizer):
    """A rasterizer without lanes: it sends a visited block's quads to the queues of shared ones.

    A quad in which no pixel reaches alpha 1/255, or whose level says that all its pixels skip the
    splat, is left out. The first operation on a block of a group goes to all quads and resets them.
    The level of a block is that of its brightest quad, found when the block is visited again.

    **Timing**: as `hdl.raster.rasterizer`, except that all blocks in flight wait while a queue that
    takes one of the first block's quads is full.
    """

    finished_places = FinishedQuads

    def __init__(self, config: Config, number: int):
        block, level = range(block_count(config)), range(ended_level(config) + 1)
        ports = {
            # all ports once per quad, row by row
            "operations": Out(stream.Signature(operation_layout(config))).array(QUADS),
            "looks": Out(1),  # request the quads' levels
            "look_block": Out(block),  # of this block
            "phase": Out(PHASE_BITS),  # the group modulo 4
            "quad_level": In(level).array(QUADS),  # a cycle later; 0 if not known
            "busy": In(QUADS),  # operations wait or are in flight
            "given": In(1).array(QUADS),  # a quad of the previous group comes
            "given_block": In(block).array(QUADS),  # of this block
            "given_pixels": In(quad_layout(config)).array(QUADS),  # its pixels
        }
        super().__init__(config, number, ports)
        self.number_at_lanes = Signal(range(self.blocks))  # the block that reaches the lanes
        self.found = Signal()  # its level is known
        self.ended, self.reached = Signal(), Signal(self.levels)

    def _blender(self, m: Module):
        m.d.comb += self.phase.eq(self.group[:PHASE_BITS])

    def _result(self) -> tuple[Value, ...]:
        return self.found, self.number_at_lanes, self.ended, self.reached

    def _blending(self) -> Value:
        return self.busy.any()

    def _leaving(self) -> Value:
        return self.busy.any()

    def _lanes(self, m: Module):
        """From E around a tile to the queues of quads, and from these to the finished blocks."""
        chosen, tile, colour, coming = self._evaluated(m)
        m.d.comb += [self.look_block.eq(coming), self.looks.eq(self.moves)]
        m.d.comb += self.number_at_lanes.eq(self._number(chosen, tile))
        visit, give, rests = self.visiting[-1], self.giving[-1], self.resting[-1]
        alphas = self.evaluate.log2_alphas
        seen = visit & Cat(pixel.seen for pixel in alphas).any()
        touched = Signal(self.blocks)  # a splat was blended into the block since it was output
        untouched = ~touched.bit_select(self.number_at_lanes, 1)
        whole, needs = give | rests | (seen & untouched), Signal(QUADS)
        inside = self._edges(tile, chosen)
        for quad, operation in enumerate(self.operations):
            pixels, o = quad_pixels(quad), operation.payload
            skips = self._skips(self.quad_level[quad], [alphas[pixel] for pixel in pixels])
            m.d.comb += [
                needs[quad].eq(whole | (visit & ~skips)),
                operation.valid.eq(needs[quad] & self.moves),
                o.block.eq(self.number_at_lanes),
                o.inside.eq(Cat(inside[pixel] for pixel in pixels)),
                o.colour.eq(Mux(rests, self.job.background, Cat(colour))),
                o.untouched.eq(untouched),
                o.give.eq(give),
                o.blends.eq(visit | rests),
                o.rest.eq(rests),
            ]
            for to, pixel in zip(o.log2_alphas, pixels, strict=True):
                m.d.comb += to.eq(
                    Cat(alphas[pixel].step, alphas[pixel].halvings, alphas[pixel].seen & visit)
                )
        ready = Cat(operation.ready for operation in self.operations)
        m.d.comb += [self.moves.eq(~(needs & ~ready).any()), self.blended.eq(seen & self.moves)]
        with m.If(self.moves & needs.any()):
            m.d.sync += touched.bit_select(self.number_at_lanes, 1).eq(visit | rests)
        self._levels(m, visit & self.moves)
        m.submodules.finished = finished = self.finished
        connect(m, finished.o, flipped(self).o)
        for quad in range(QUADS):
            m.d.comb += [
                finished.valid[quad].eq(self.given[quad]),
                finished.block[quad].eq(self.given_block[quad]),
                finished.pixels[quad].eq(self.given_pixels[quad]),
            ]

    def _skips(self, level: Value, alphas: Sequence[Value]) -> Value:
        """High if no pixel of a quad at this level can change."""
        shows = []
        for alpha in alphas:
            faint = [
                (level == k) & (alpha.halvings >= halvings_min(self.config, k))
                for k in range(1, self.levels + 1)
            ]
            shows.append(alpha.seen & ~Cat(faint).any())
        return (level == ended_level(self.config)) | ~Cat(shows).any()

    def _levels(self, m: Module, visit: Value):
        """The level of the block at the lanes, as far as its quads' are known."""
        levels = self.quad_level
        least = [Cat(level >= k for level in levels).all() for k in range(1, self.levels + 1)]
        m.d.comb += [
            self.ended.eq(Cat(level == ended_level(self.config) for level in levels).all()),
            self.reached.eq(Cat(least)),
            self.found.eq(visit & (self.ended | self.reached.any())),
        ]


def share_lanes(m: Module, name: str, feeders: Sequence[Feeder]):
    """Add the quads that rasterizers share. name: prefix of their names"""
    for number in range(QUADS):
        m.submodules[f"{name}_quad{number}"] = quad = Quad(feeders[0].config)
        for k, feeder in enumerate(feeders):
            own = quad_of(k, number)
            connect(m, feeder.operations[own], quad.i[k])
            m.d.comb += [
                quad.looks[k].eq(feeder.looks),
                quad.block[k].eq(feeder.look_block),
                quad.phase[k].eq(feeder.phase),
                feeder.quad_level[own].eq(quad.level[k]),
                feeder.busy[own].eq(quad.busy[k]),
                feeder.given[own].eq(quad.given[k]),
                feeder.given_block[own].eq(quad.given_block[k]),
                feeder.given_pixels[own].eq(quad.o),
            ]
