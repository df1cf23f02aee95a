"""Properties of finished blocks that come quad by quad, to check by a search from the reset."""

from dataclasses import replace
from functools import partial

from amaranth.hdl import Array, Assert, Assume, Cat, Cover, Module, ResetSignal, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import passes
from splatcore.hdl.raster.finished import nth
from splatcore.hdl.raster.finished_quads import FinishedQuads
from splatcore.spec.config import TINY, Config
from splatcore.spec.quads import QUADS, quad_pixels
from splatcore.spec.raster import block_count
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

TWO = replace(TINY, rasterizers=8, group=1, port=256, lanes="quads")  # blocks per group
ONE = replace(TWO, rasterizers=16)

READY_WITHIN = 3  # cycles from the one in which a block's last quad comes


class Finish(wiring.Component):
    """Quads of blocks that come in any order and at any time, one bit of pixels each.

    Asserts:
    - blocks leave in the order of `nth`, each once per group, none before all of its quads came;
    - each quad has the pixels that came for it, in its place of the block;
    - a block whose turn it is leaves as soon as it can; no quad is overwritten.

    Assumes: a quad does not come again before its block has left; no further reset.
    """

    def __init__(self, config: Config):
        self.config, self.blocks = config, block_count(config)
        quads = {"valid": In(1), "block": In(1), "bit": In(1)}
        ports = {name: port.array(QUADS) for name, port in quads.items()}
        super().__init__(ports | {"ready": In(1)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.part = part = FinishedQuads(self.config)
        m.d.comb += [Assume(~ResetSignal()), part.o.ready.eq(self.ready)]
        number, late = Signal(range(self.blocks)), Signal(range(READY_WITHIN + 1))
        block, whole = nth(self.config, number), []
        for quad in range(QUADS):
            came = Signal(self.blocks, name=f"came{quad}")  # by block
            bits = Signal(self.blocks, name=f"bits{quad}")
            valid, at = self.valid[quad], self.block[quad]
            m.d.comb += [
                part.valid[quad].eq(valid),
                part.block[quad].eq(at),
                part.pixels[quad].as_value().eq(self.bit[quad]),
                Assume(~valid | ((at < self.blocks) & ~came.bit_select(at, 1))),
            ]
            with m.If(passes(part.o)):
                m.d.sync += came.bit_select(block, 1).eq(0)
            with m.If(valid):
                m.d.sync += [
                    came.bit_select(at, 1).eq(1),
                    bits.bit_select(at, 1).eq(self.bit[quad]),
                ]
            whole.append(Array(came)[block])
            first = part.o.payload.pixels[quad_pixels(quad)[0]].as_value()
            m.d.comb += Assert(~part.o.valid | (first == Array(bits)[block]))
        m.d.comb += [
            Assert(~part.o.valid | Cat(whole).all()),
            Assert(late != READY_WITHIN),
            Cover(passes(part.o) & (number == self.blocks - 1)),
        ]
        m.d.sync += late.eq(0)
        with m.If(Cat(whole).all() & ~part.o.valid):
            m.d.sync += late.eq(late + 1)
        with m.If(passes(part.o)):
            m.d.sync += number.eq(number + 1)
        return m


DEPTH = 9  # cycles within which all blocks of two groups can leave

FAULTS = planted_in(
    FinishedQuads,
    elaborate={
        "one quad is a block": ("for here in present).all()", "for here in present).any()"),
        "a block leaves twice": ("whole & ~(left & (left_block == block))", "whole"),
        "a waiting block is overwritten": ("(~o.valid | o.ready)", "1"),
        "a block is lost if not taken at once": (
            "o.valid.eq(reads | (o.valid & ~o.ready))",
            "o.valid.eq(reads)",
        ),
        "a block never leaves": ("(here & ~leaves) | comes", "here | comes"),
        "the next block is forgotten": ("(here & ~leaves) | comes", "comes"),
        "quads trade places": ("zip(quad_pixels(quad),", "zip(quad_pixels(QUADS - 1 - quad),"),
    },
)

PARTS = {
    name: Part(partial(Finish, config), search=DEPTH, cover=DEPTH)
    for name, config in (("two blocks", TWO), ("one block", ONE))
}

PROOF = Proof(PARTS, FAULTS, {"a block leaves twice": PARTS["one block"]})
