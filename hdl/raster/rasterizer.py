"""A rasterizer: blends pairs into the blocks that it owns in every tile of a group."""

from collections.abc import Sequence

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.holds import enough, never_waits
from splatcore.hdl.lib.latency import Pipeline
from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.shift import encoded, lowest
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.spec import raster
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Record

PAIRS_WAITING = 16
"""Pairs that may wait before a rasterizer: others may have more to do with the same splats."""

OUTPUT_SPARE = 10  # blocks on their way when the queue of finished ones may no longer be added to


class Rasterizer(wiring.Component):
    """Evaluates and blends one marked block a cycle; gives a group's pixels out at its end.

    Members
        i: stream of `marked_record` with this rasterizer's blocks by level, or a group's end.
        positions: stream of `position_record`, one for each group.
        width, height: of the image, pixels. background: a colour.
        started, group: a group is being rasterized, and its number modulo 2^GROUP_BITS.
        live: blocks of each of the group's tiles that have live pixels. level: for each level from
            1 on (`spec.raster.mark_min`) those that are at it, or at a higher one.
        o: stream of `pixels_record`: the group's blocks within the image.
        blended, waited: a block enters the lanes; none does although the group has not ended.
        pairs, finished: the queues of pairs and of blocks to be given out (for tests).

    **Timing**: a marked block a cycle, but for those in which no pixel reaches alpha 1/255 and for
    blocks that come again within `Blend.BUSY` cycles; and for each group a cycle for every block.
    """

    def __init__(self, config: Config, number: int):
        self.config, self.number, self.own = config, number, raster.owned(config, number)
        self.tiles = config.group**2
        self.blocks = self.tiles * len(self.own)
        self.levels = len(raster.mark_min(config)) - 1
        pair = raster.marked_record(config, Array(Bits(len(self.own)), 1 + self.levels))
        pixels = raster.pixels_record(config)
        self.pairs = Queue(layout(pair), PAIRS_WAITING, memory=True)
        # Blocks that `level` does not count: on their way, entering now, just arrived.
        on_the_way = 2 + Evaluate.LATENCY + Blend.LATENCY
        enough(OUTPUT_SPARE, on_the_way, "OUTPUT_SPARE, rows for blocks on their way")
        self.finished = Queue(layout(pixels), self.blocks + OUTPUT_SPARE, memory=True)
        ports = {
            "i": In(stream.Signature(layout(pair))),
            "positions": In(stream.Signature(layout(raster.position_record(config)))),
            "width": In(range(config.width_max + 1)),
            "height": In(range(config.height_max + 1)),
            "background": In(layout(Record("colour", raster.colours(config)))),
            "started": Out(1),
            "group": Out(raster.GROUP_BITS, init=-1),
            "live": Out(data.ArrayLayout(len(self.own), self.tiles)),
            "level": Out(data.ArrayLayout(len(self.own), self.tiles)).array(self.levels),
            "o": Out(stream.Signature(layout(pixels))),
            "blended": Out(1),
            "waited": Out(1),
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.pairs = self.pairs
        m.submodules.evaluate = self.evaluate = Evaluate(self.config, self.number)
        m.submodules.blend = self.blend = Blend(self.config, self.blocks)
        connect(m, flipped(self).i, self.pairs.i)
        self.position = Signal(layout(raster.position_record(self.config)))
        self.moves = Signal()  # blocks before the lanes move on
        self.on_the_way = Signal(1 + Evaluate.LATENCY)  # valid bits of the stages before the lanes
        self.issued, self.tile = Signal(), Signal(range(self.tiles))  # a block, and its tile
        self.chosen, self.final = Signal(len(self.own)), Signal()  # which one; at the group's end
        self.room = Signal()  # in the queue of finished blocks
        self._begin(m)
        self._lanes(m, self._issue(m))
        return m

    def wanted(self, blocks: Sequence[Value], tile: Value) -> Value:
        """Of blocks of a tile by level those that have live pixels and are not at a higher level,
        as far as known."""
        found = blocks[0] & self.live[tile]
        for level, reached in zip(self.level, list(blocks)[1:], strict=True):
            found &= reached | ~level[tile]
        return found

    def _inside(self, number: Value, size: Value, step: int) -> Value:
        """A bit for every `step`-th column (row) of a group: it is within the image."""
        side = TILE * self.config.group
        rest = (size - number * side).as_signed()
        return Cat(rest > k * step for k in range(side // step))

    def _begin(self, m: Module):
        """A group begins when its position is known and the last one's blocks are in the lanes."""
        position = self.positions.payload
        m.d.comb += self.positions.ready.eq(~self.started & ~self.on_the_way.any())
        columns = self._inside(position.column, self.width, BLOCK)
        rows = self._inside(position.row, self.height, BLOCK)
        with m.If(self.positions.valid & self.positions.ready):
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
        with m.Elif(self.blend.blended):
            block = self.blend.blended_block
            m.d.sync += self.live.as_value().bit_select(block, 1).eq(~self.blend.ended)
            for level, reached in zip(self.level, self.blend.level, strict=True):
                m.d.sync += level.as_value().bit_select(block, 1).eq(reached)

    def _issue(self, m: Module) -> Value:
        """The next block: of the pair at hand, unless it is not wanted any more; or at the group's
        end one after the other, to be given out, after a first time in which the background, if
        any, is blended into them."""
        pair, own = self.pairs.o.payload, len(self.own)
        done, count = Signal(own), Signal(range(self.blocks))
        left, lowest_left = Signal(own), Signal(own)
        valid = self.started & self.pairs.o.valid
        giving = Signal()
        last = count == self.blocks - 1
        give = pair.end & (giving | ~self.background.as_value().any())
        bits = (own - 1).bit_length()
        counted = Cat((count[:bits] if bits else 0) == k for k in range(own))
        m.d.comb += [
            left.eq(self.wanted(pair.blocks, pair.tile) & ~done),
            lowest_left.eq(lowest(left)),
            self.final.eq(pair.end),
            self.chosen.eq(Mux(pair.end, counted, lowest_left)),
            self.tile.eq(Mux(pair.end, count >> bits, pair.tile)),
            self.issued.eq(valid & Mux(pair.end, self.room, left.any())),
            self.pairs.o.ready.eq(
                self.moves & valid & Mux(pair.end, self.room & last & give, left == lowest_left)
            ),
            self.waited.eq(self.started & ~(valid & pair.end)),
        ]
        with m.If(self.moves & self.issued):
            m.d.sync += done.eq(done | lowest_left)
            with m.If(pair.end):
                m.d.sync += count.eq(Mux(last, 0, count + 1))
                with m.If(last):
                    m.d.sync += [giving.eq(~give), self.started.eq(~give)]
        with m.If(self.pairs.o.valid & self.pairs.o.ready):
            m.d.sync += done.eq(0)
        return give

    def _lanes(self, m: Module, give: Value):
        """From E around a tile to the lanes, and from these to the queue of finished blocks."""
        pair, evaluate, blend = self.pairs.o.payload, self.evaluate, self.blend
        cuts = ("issued", *(f"evaluate{k}" for k in range(evaluate.LATENCY)))
        pipeline = Pipeline(m, self.moves, dict.fromkeys(cuts, 1))
        quadratic, chosen, *rest = pipeline.cut(
            "issued", pair.quadratic, self.chosen, self.tile, self.final, give,
            *(pair[name] for name in raster.COLOURS),
        )  # fmt: skip
        m.d.comb += [evaluate.quadratic.eq(quadratic), evaluate.number.eq(chosen)]
        m.d.comb += evaluate.enable.eq(self.moves)
        for cut in cuts[1:]:
            chosen, *rest = pipeline.cut(cut, chosen, *rest)
        tile, final, give, *colour = rest
        valid = self.on_the_way
        with m.If(self.moves):
            m.d.sync += valid.eq(Cat(self.issued, valid))
        seen = Cat(pixel.seen for pixel in evaluate.log2_alphas).any()
        m.d.comb += [
            blend.valid.eq(valid[-1] & (final | seen)),
            blend.block.eq(tile * len(self.own) + encoded(chosen) if len(self.own) > 1 else tile),
            blend.log2_alphas.eq(evaluate.log2_alphas),
            blend.colour.eq(Mux(final, self.background, Cat(colour))),
            blend.rest.eq(final),
            blend.give.eq(give),
            self.moves.eq(~blend.valid | ~blend.busy),
            self.blended.eq(blend.valid & ~blend.busy & ~final),
        ]
        self._give(m, *self._edges(m, tile, chosen))

    def _edges(self, m: Module, tile: Value, chosen: Value) -> tuple[Value, Value]:
        """A block's column and row in the image, and a bit for each of its pixels within."""
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
        across = [column * BLOCK + k < self.width for k in range(BLOCK)]
        down = [row * BLOCK + k < self.height for k in range(BLOCK)]
        m.d.comb += self.blend.inside.eq(Cat(a & d for d in down for a in across))
        return column, row

    def _give(self, m: Module, column: Value, row: Value):
        """Finished blocks, but those outside the image, wait in a queue for all of a group."""
        m.submodules.finished = queue = self.finished
        connect(m, queue.o, flipped(self).o)
        widths = len(self.o.payload.column), len(self.o.payload.row)
        block = Cat(column[: widths[0]], row[: widths[1]], self.blend.inside[0])
        for k in range(self.blend.LATENCY):
            register = Signal(len(block), name=f"block_{k}", reset_less=True)
            m.d.sync += register.eq(block)
            block = register
        m.d.comb += [
            self.room.eq(queue.level <= self.blocks),
            queue.i.valid.eq(self.blend.given & block[-1]),
            queue.i.payload.column.eq(block[: widths[0]]),
            queue.i.payload.row.eq(block[widths[0] : -1]),
            queue.i.payload.pixels.eq(self.blend.o),
        ]
        never_waits(m, "finished", queue.i, "a finished block: OUTPUT_SPARE")
