"""Stage 3, sixth step with shared lanes: quads of lanes, each with a queue for two rasterizers."""

from amaranth.hdl import Cat, Module, Mux, Signal, Value
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.lib.record import layout
from splatcore.hdl.lib.stream import Queue, passes
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import log2_alpha_layout
from splatcore.hdl.raster.finished_quads import quad_layout
from splatcore.spec.config import Config
from splatcore.spec.quads import QUADS, ended_level, quad_pixels
from splatcore.spec.raster import block_count, colours
from splatcore.spec.record import Record

SHARE = 2  # rasterizers that share lanes

OPERATIONS_WAITING = 8
"""Operations of a rasterizer that may wait for a quad while its other quads go on."""

RESULT_CYCLES = Blend.LATENCY
"""Cycles after an operation enters the lanes in which it may still change a quad's level, or be
output."""


PHASE_BITS = 2
"""Bits of a group's number that are kept with a level: each block is reset once per group, possibly
before the group begins, so that a level that was not written yet is one or two groups old."""


def quad_of(number: int, quad: int) -> int:
    """Return the lanes' quad for a quad of a rasterizer's block: the second of the rasterizers that
    share lanes has its blocks turned by 180°, so that an edge of a splat keeps all quads busy.
    """
    return QUADS - 1 - quad if number else quad


def operation_layout(config: Config) -> data.StructLayout:
    """An operation on the quad of a block, as at the ports of `hdl.raster.blend`."""
    pixels = len(quad_pixels(0))
    return data.StructLayout({
        "block": range(block_count(config)),
        "log2_alphas": data.ArrayLayout(log2_alpha_layout(config), pixels),
        "inside": pixels,
        "colour": layout(Record("colour", colours(config))),
    } | dict.fromkeys(("untouched", "give", "blends", "rest"), 1))  # fmt: skip


class Quad(wiring.Component):
    """Four lanes: a pixel position's neighbourhood of 2×2 in all blocks of two rasterizers.

    Operations of a rasterizer stay in order; those of two rasterizers are on different pixels. The
    longer queue goes first, unless its block has to wait for itself. The level of a block's quad is
    that of its brightest pixel; its memory is not read where it is written in the same cycle.

    Internal:
        queues: one per rasterizer

    **Timing**: an operation enters the lanes two cycles after it came, one per cycle. The level is
    readable from the fifth cycle after that. Memories: two queues, two of levels, and those of
    `hdl.raster.blend`.
    """

    def __init__(self, config: Config):
        self.config, self.blocks = config, block_count(config)
        operation, number = operation_layout(config), range(self.blocks)
        self.queues = [Queue(operation, OPERATIONS_WAITING, memory=True) for _ in range(SHARE)]
        ports = {
            # all ports come once per rasterizer, except `o`
            "i": In(stream.Signature(operation)).array(SHARE),
            "looks": In(1).array(SHARE),  # request the level of a block
            "block": In(number).array(SHARE),  # that block
            "phase": In(PHASE_BITS).array(SHARE),  # the rasterizer's group modulo 4
            # the quad's level a cycle later; 0 if not known
            "level": Out(range(ended_level(config) + 1)).array(SHARE),
            "busy": Out(1).array(SHARE),  # operations wait or are in flight
            "given": Out(1).array(SHARE),  # `o` is the quad of block `given_block`
            "given_block": Out(number).array(SHARE),
            "o": Out(quad_layout(config)),
        }
        super().__init__(ports)
        self.cleared = Signal(SHARE)  # per rasterizer: the memory of levels

    def elaborate(self, platform) -> Module:
        m = Module()
        pixels = len(quad_pixels(0))
        m.submodules.blend = blend = Blend(self.config, SHARE * self.blocks, pixels, SHARE)
        self._choose(m, blend)
        m.d.comb += self.o.eq(blend.o)
        late, late_valid = Signal(blend.number), Signal()
        level = Signal.like(self.level[0])
        m.d.sync += [late_valid.eq(blend.blended), late.eq(blend.blended_block)]
        m.d.sync += level.eq(Mux(blend.ended, ended_level(self.config), sum(blend.level)))
        place, of = late[:-1], late[-1]
        for k in range(SHARE):
            m.d.comb += self.given[k].eq(blend.given & (blend.given_block[-1] == k))
            m.d.comb += self.given_block[k].eq(blend.given_block[:-1])
            self._levels(m, k, late_valid & (of == k), place, level)
        return m

    def _choose(self, m: Module, blend: Blend):
        """The next operation to the lanes, which are then busy with it for `RESULT_CYCLES`."""
        heads, can = [queue.o for queue in self.queues], Signal(SHARE)
        turn, prefers, second = Signal(), Signal(), Signal()
        levels = [queue.level for queue in self.queues]
        m.d.sync += turn.eq(~turn)
        m.d.comb += [
            can.eq(Cat(head.valid for head in heads) & ~blend.waits),
            prefers.eq(Mux(levels[0] == levels[1], turn, levels[1] > levels[0])),
            second.eq(Mux(prefers, can[1], ~can[0])),
            blend.valid.eq(can.any()),
            blend.block.eq(Mux(second, blend.choices[1], blend.choices[0])),
        ]
        chosen = Signal(heads[0].payload.shape())
        m.d.comb += chosen.eq(Mux(second, heads[1].payload, heads[0].payload))
        for name in heads[0].payload.shape().members:
            if name != "block":
                m.d.comb += getattr(blend, name).eq(chosen[name])
        for k, (queue, head) in enumerate(zip(self.queues, heads, strict=True)):
            m.submodules[f"queue{k}"] = queue
            connect(m, flipped(self.i[k]), queue.i)
            busy = Signal(RESULT_CYCLES, name=f"busy{k}")
            m.d.comb += [
                blend.choices[k].eq(Cat(head.payload.block, k)),
                head.ready.eq(can[k] & (second == k)),
                self.busy[k].eq(queue.level.any() | busy.any() | ~self.cleared[k]),
            ]
            m.d.sync += busy.eq(Cat(passes(head), busy))

    def _levels(self, m: Module, k: int, valid: Value, block: Value, level: Value):
        """Memory of a rasterizer's levels; a row is known if it was written in the present group.

        After a reset the rows are written first, so that none is known by chance.
        """
        row = data.StructLayout({"level": level.shape(), "phase": PHASE_BITS})
        m.submodules[f"levels{k}"] = memory = Memory(shape=row, depth=self.blocks, init=[])
        write, read = memory.write_port(), memory.read_port()
        clear = Signal(range(self.blocks + 1), name=f"clear{k}")
        clears, collides = ~self.cleared[k], Signal(name=f"collides{k}")
        m.d.comb += self.cleared[k].eq(clear[-1])
        m.d.sync += clear.eq(clear + clears)
        m.d.comb += [
            write.en.eq(clears | valid),
            write.addr.eq(Mux(clears, clear[:-1], block)),
            write.data.level.eq(Mux(clears, 0, level)),
            write.data.phase.eq(self.phase[k]),
            read.en.eq(self.looks[k] & ~(write.en & (write.addr == self.block[k]))),
            read.addr.eq(self.block[k]),
        ]
        with m.If(self.looks[k]):
            m.d.sync += collides.eq(~read.en)
        known = ~collides & (read.data.phase == self.phase[k])
        m.d.comb += self.level[k].eq(Mux(known, read.data.level, 0))
