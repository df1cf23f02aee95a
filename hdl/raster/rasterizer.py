"""A rasterizer: blends pairs into the blocks that it owns in every tile of a group.

A group's blocks are output while the next group is blended: each with the first splat that comes to
it, because the lanes reset it then, or one after the other, when the lanes are idle.
"""

from collections.abc import Sequence

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out, connect, flipped
from amaranth.utils import exact_log2

from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import layout, stream_of
from splatcore.hdl.lib.shift import encoded, lowest, several
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.hdl.raster.finished import Finished, nth
from splatcore.hdl.raster.job import job_layout
from splatcore.spec import raster
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.number import Bits
from splatcore.spec.record import Array

PAIRS_WAITING = 16
"""Pairs that may wait before a rasterizer: others may have more blocks of the same splats."""

STAGES = 1 + Evaluate.LATENCY
"""Stages of blocks in flight to the lanes."""


class Rasterizer(wiring.Component):
    """Evaluates and blends one marked block per cycle; outputs a group's pixels after its end.

    Internal:
        pairs: the queue of pairs
        finished: the blocks that have been output by the lanes

    **Timing**: one marked block per cycle, except blocks in which no pixel reaches alpha 1/255 and
    blocks that come again within `Blend.BUSY` cycles. A group takes at least one cycle per block of
    the previous group, and one more per block with a background.
    """

    finished_places = Finished
    """Component that holds finished blocks."""

    def __init__(self, config: Config, number: int, lane_ports: dict | None = None):
        self.config, self.number, self.own = config, number, raster.owned(config, number)
        self.tiles = config.group**2
        self.blocks = self.tiles * len(self.own)
        self.levels = len(raster.mark_min(config)) - 1
        pair = raster.marked_record(config, Array(Bits(len(self.own)), 1 + self.levels))
        self.pairs = Queue(layout(pair), PAIRS_WAITING, memory=True)
        self.finished = self.finished_places(config)
        ports = {
            # `marked_record` with this rasterizer's blocks by level, or a group's end
            "i": In(stream_of(pair)),
            "positions": In(stream_of(raster.position_record(config))),  # one per group
            "job": In(job_layout(config)),
            "started": Out(1),  # a group is being rasterized
            "group": Out(raster.GROUP_BITS, init=-1),  # its number modulo 2^GROUP_BITS
            # blocks of each of the group's tiles that have live pixels
            "live": Out(data.ArrayLayout(len(self.own), self.tiles)),
            # for each level from 1 on (`spec.raster.mark_min`), blocks that are at it or above
            "level": Out(data.ArrayLayout(len(self.own), self.tiles)).array(self.levels),
            # the group's blocks (`spec.raster.nth_block`)
            "o": Out(stream_of(raster.pixels_record(config))),
            "blended": Out(1),  # a block enters the lanes
            "waited": Out(1),  # no block enters the lanes although the group has not ended
        }
        super().__init__(ports | (lane_ports or {}))  # to lanes outside

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pairs = self.pairs
        m.submodules.evaluate = self.evaluate = Evaluate(self.config, self.number)
        self._blender(m)
        connect(m, flipped(self).i, self.pairs.i)
        self.position = Signal(layout(raster.position_record(self.config)))
        self.moves = Signal()  # blocks before the lanes advance
        # Operations of the block being issued, and of blocks in flight to the lanes. That a visit
        # outputs the block as well, because it is stale, is known a cycle later.
        self.visits, self.gives, self.rests = Signal(), Signal(), Signal()
        self.visiting, self.giving, self.resting = Signal(STAGES), Signal(STAGES), Signal(STAGES)
        self.tile, self.chosen = Signal(range(self.tiles)), Signal(len(self.own))  # of the block
        # Blocks not yet output since their group ended; of these, blocks whose place is still taken
        # by the previous group.
        blocks = data.ArrayLayout(len(self.own), self.tiles)
        self.stale, self.blocked = Signal(blocks), Signal(blocks)
        self._begin(m)
        self._issue(m)
        self._lanes(m)
        return m

    def _blender(self, m: Module):
        """Add the lanes."""
        m.submodules.blend = self.blend = Blend(self.config, self.blocks)

    def _result(self) -> tuple[Value, ...]:
        """A block's result: valid, its number, all its pixels are terminated, its levels."""
        blend = self.blend
        return blend.blended, blend.blended_block, blend.ended, blend.level

    def _blending(self) -> Value:
        """High while a result may still come."""
        return self.blend.entered

    def _leaving(self) -> Value:
        """High while the lanes hold a block to be output."""
        return self.blend.giving

    def wanted(self, blocks: Sequence[Value], tile: Value) -> Value:
        """Blocks of a tile that have live pixels and are not at a higher level, as far as known.

        blocks: the tile's blocks by level
        """
        found = blocks[0] & self.live[tile]
        for level, reached in zip(self.level, list(blocks)[1:], strict=True):
            found &= reached | ~level[tile]
        return found

    def _inside(self, number: Value, size: Value, step: int) -> Value:
        """One bit for every `step`-th column (row) of a group: it is within the image."""
        side = TILE * self.config.group
        rest = (size - number * side).as_signed()
        return Cat(rest > k * step for k in range(side // step))

    def _begin(self, m: Module):
        """Begin a group when its position is known and the previous group has been blended."""
        position = self.positions.payload
        behind = self.visiting.any() | self._blending()
        m.d.comb += self.positions.ready.eq(~self.started & ~behind)
        columns = self._inside(position.column, self.job.width, BLOCK)
        rows = self._inside(position.row, self.job.height, BLOCK)
        begins = self.positions.valid & self.positions.ready
        # The result of a block is known here a cycle later, unless its group is over then.
        blended, block, ended, reached = self._result()
        shape = {"block": range(self.blocks), "ended": 1, "level": self.levels}
        late, late_valid = Signal(data.StructLayout(shape), reset_less=True), Signal()
        m.d.sync += late_valid.eq(blended & ~begins)
        m.d.sync += late.eq(Cat(block, ended, reached))
        with m.If(begins):
            m.d.sync += [self.started.eq(1), self.position.eq(position)]
            m.d.sync += self.group.eq(self.group + 1)
            for tile in range(self.tiles):
                row, column = divmod(tile, self.config.group)
                inside = [
                    columns[column * raster.BLOCKS + block % raster.BLOCKS]
                    & rows[row * raster.BLOCKS + block // raster.BLOCKS]
                    for block in self.own
                ]
                m.d.sync += self.live[tile].eq(Cat(inside))
            m.d.sync += [level.as_value().eq(0) for level in self.level]
        with m.Elif(late_valid):
            m.d.sync += self.live.as_value().bit_select(late.block, 1).eq(~late.ended)
            for level, reached in zip(self.level, late.level, strict=True):
                m.d.sync += level.as_value().bit_select(late.block, 1).eq(reached)

    def _issue(self, m: Module):
        """Issue the next block: of the present pair if it is still wanted; else one of the previous
        group, to be output.
        """
        pair, own = self.pairs.o.payload, len(self.own)
        done, left, open_, lowest_left = Signal(own), Signal(own), Signal(own), Signal(own)
        valid = self.started & self.pairs.o.valid
        m.d.comb += [
            self.blocked.as_value().eq(self.stale.as_value() & self.finished.taken),
            left.eq(self.wanted(pair.blocks, pair.tile) & ~done),
            open_.eq(left & ~self.blocked[pair.tile]),
            lowest_left.eq(lowest(open_)),
            self.visits.eq(valid & ~pair.end & open_.any()),
        ]
        tile, chosen, ends = self._scan(m, valid & pair.end)
        last = ~several(left) & ~(left & self.blocked[pair.tile]).any()  # left is lowest_left
        leaves = self.moves & valid & Mux(pair.end, ends, last)
        m.d.comb += [
            self.chosen.eq(Mux(self.visits, lowest_left, chosen)),
            self.tile.eq(Mux(self.visits, pair.tile, tile)),
            self.pairs.o.ready.eq(leaves),
            self.waited.eq(self.started & ~(valid & pair.end)),
        ]
        with m.If(leaves):
            m.d.sync += done.eq(0)
        with m.Elif(self.moves & self.visits):
            m.d.sync += done.eq(done | lowest_left)
        with m.If(leaves & pair.end):
            m.d.sync += [self.started.eq(0), self.stale.as_value().eq(~0)]
        with m.Elif(self.moves):
            for number, row in enumerate(self.stale):
                visited = Mux(valid & ~pair.end & (pair.tile == number), lowest_left, 0)
                given = Mux(self.gives & (tile == number), chosen, 0)
                m.d.sync += row.eq(row & ~(visited | given))

    def _scan(self, m: Module, end: Value) -> tuple[Value, Value, Value]:
        """Visit one block after the other: while the lanes are idle, those to be output that have
        not been since their group ended; at the group's end all, to blend the background into them
        if there is one.

        end: the group's end is the present pair
        Returns a block's tile, which block of the tile it is, and whether the group ends.
        """
        own, bits = len(self.own), exact_log2(len(self.own))
        count, again = Signal(range(self.blocks + 1), init=self.blocks), Signal()
        number, through = nth(self.config, count[:-1]), count[-1]
        stale, blocked = (
            blocks.as_value().bit_select(number, 1) for blocks in (self.stale, self.blocked)
        )
        background = self.job.background.as_value().any()
        behind = self.giving.any() | self._leaving()  # one may still be in flight to its place
        m.d.comb += [
            self.gives.eq(~through & ~again & ~self.visits & stale & ~blocked),
            self.rests.eq(~through & again),
        ]
        ends = end & through & (again | ~background) & ~behind
        with m.If(through & end):
            with m.If(background & ~again):
                m.d.sync += [again.eq(1), count.eq(0)]
            with m.Elif(self.moves & ends):
                m.d.sync += [again.eq(0), count.eq(0)]
        with m.Elif(~through & Mux(again | self.gives, self.moves, ~stale)):
            m.d.sync += count.eq(count + 1)
        chosen = Cat((number[:bits] if bits else 0) == k for k in range(own))
        return number[bits:], chosen, ends

    def _lanes(self, m: Module):
        """From E around a tile to the lanes, and from these to the finished blocks."""
        blend = self.blend
        chosen, tile, colour, coming = self._evaluated(m)
        visit, give, rests = self.visiting[-1], self.giving[-1], self.resting[-1]
        seen = visit & Cat(pixel.seen for pixel in self.evaluate.log2_alphas).any()
        m.d.comb += [
            blend.valid.eq(seen | give | rests),
            blend.block.eq(self._number(chosen, tile)),
            *((blend.coming.eq(coming),) if self.config.logic == "fpga" else ()),
            blend.give.eq(give),
            blend.blends.eq(visit | rests),
            blend.rest.eq(rests),
            blend.log2_alphas.eq(self.evaluate.log2_alphas),
            blend.colour.eq(Mux(rests, self.job.background, Cat(colour))),
            blend.inside.eq(self._edges(tile, chosen)),
            self.moves.eq(~blend.valid | ~blend.busy),
            self.blended.eq(seen & ~blend.busy),
        ]
        m.submodules.finished = finished = self.finished
        connect(m, finished.o, flipped(self).o)
        m.d.comb += [
            finished.valid.eq(blend.given),
            finished.block.eq(blend.given_block),
            finished.pixels.eq(blend.o),
        ]

    def _evaluated(self, m: Module) -> tuple[Value, Value, list[Value], Value]:
        """The block that reaches the lanes: which of its tile's, its tile, its splat's colour; and
        the number of the block behind it.
        """
        pair, evaluate = self.pairs.o.payload, self.evaluate
        cuts = ("issued", *(f"evaluate{k}" for k in range(evaluate.LATENCY)))
        enters, inside = Signal(STAGES), self.visiting | self.giving | self.resting
        issued = self.visits | self.gives | self.rests
        m.d.comb += enters.eq(Mux(self.moves, Cat(issued, inside), 0))
        pipeline = Pipeline(m, enters, dict.fromkeys(cuts, 1))
        quadratic, stale, chosen, *rest = pipeline.cut(
            "issued", pair.quadratic, self.stale[pair.tile], self.chosen, self.tile,
            *(pair[name] for name in raster.COLOURS),
        )  # fmt: skip
        m.d.comb += [evaluate.quadratic.eq(quadratic), evaluate.number.eq(chosen)]
        m.d.comb += evaluate.enable.eq(Mux(self.moves, self.visiting, 0)[: evaluate.LATENCY])
        given, later = Signal(), Signal(STAGES - 1)
        gives = given | (self.visiting[0] & (stale & chosen).any())
        for cut in cuts[1:]:
            coming = self._number(chosen, rest[0])
            chosen, *rest = pipeline.cut(cut, chosen, *rest)
        tile, *colour = rest
        m.d.comb += self.giving.eq(Cat(gives, later))
        with m.If(self.moves):
            m.d.sync += [
                self.visiting.eq(Cat(self.visits, self.visiting)),
                given.eq(self.gives),
                later.eq(self.giving),
                self.resting.eq(Cat(self.rests, self.resting)),
            ]
        return chosen, tile, colour, coming

    def _number(self, chosen: Value, tile: Value) -> Value:
        """A block's number in the memories of pixels."""
        return tile * len(self.own) + encoded(chosen) if len(self.own) > 1 else tile

    def _edges(self, tile: Value, chosen: Value) -> Value:
        """One bit per pixel of a block: it is within the image."""
        side = self.config.group
        columns = Mux(chosen[0], self.own[0] % raster.BLOCKS, 0)
        rows = Mux(chosen[0], self.own[0] // raster.BLOCKS, 0)
        for k, block in enumerate(self.own[1:], 1):
            columns |= Mux(chosen[k], block % raster.BLOCKS, 0)
            rows |= Mux(chosen[k], block // raster.BLOCKS, 0)
        tile_bits = (side - 1).bit_length()
        tile_column, tile_row = tile[:tile_bits], tile[tile_bits:]
        if side == 1:
            tile_column = tile_row = 0
        column = (self.position.column * side + tile_column) * raster.BLOCKS + columns
        row = (self.position.row * side + tile_row) * raster.BLOCKS + rows
        across = [column * BLOCK + k < self.job.width for k in range(BLOCK)]
        down = [row * BLOCK + k < self.job.height for k in range(BLOCK)]
        return Cat(a & d for d in down for a in across)
