"""Finished blocks of a rasterizer that come quad by quad, until they are written to the image."""

from amaranth.hdl import Cat, Module, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.holds import holds
from splatcore.hdl.lib.record import layout
from splatcore.hdl.raster.finished import nth
from splatcore.spec.config import Config
from splatcore.spec.quads import QUADS, quad_pixels
from splatcore.spec.raster import block_count, pixels_record
from splatcore.spec.work import pixel_bytes


def quad_layout(config: Config) -> data.ArrayLayout:
    """The bytes of a quad's pixels, row by row."""
    return data.ArrayLayout(data.ArrayLayout(8, pixel_bytes(config.rgba)), len(quad_pixels(0)))


class FinishedQuads(wiring.Component):
    """A place for each of a rasterizer's blocks of a group.

    A block's quads come in any order, and blocks leave in the order of `spec.raster.nth_block`,
    group after group.

    **Timing**: each quad of one block per cycle; a block can leave two cycles after its last quad
    came. One memory per quad with a row per block, a write port and a read port.
    """

    def __init__(self, config: Config):
        self.config, self.blocks = config, block_count(config)
        record, number = layout(pixels_record(config)), range(self.blocks)
        self.quad = quad_layout(config)
        ports = {
            "valid": In(1).array(QUADS),  # a quad comes; its place must be free
            "block": In(number).array(QUADS),  # the number of its block in the group
            "pixels": In(self.quad).array(QUADS),  # its pixels
            "taken": Out(self.blocks),  # one bit per place: a quad of its block is there
            "o": Out(stream.Signature(record)),  # `pixels_record`
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        o, number, reads = self.o, Signal(range(self.blocks)), Signal()
        block = nth(self.config, number)  # the next one to leave
        left, left_block = Signal(), Signal.like(number)
        present = []
        for quad in range(QUADS):
            m.submodules[f"quad{quad}"] = memory = Memory(
                shape=self.quad, depth=self.blocks, init=[]
            )
            write, read = memory.write_port(), memory.read_port()
            m.d.comb += [
                write.en.eq(self.valid[quad]),
                write.addr.eq(self.block[quad]),
                write.data.eq(self.pixels[quad]),
                read.en.eq(reads),
                read.addr.eq(block),
            ]
            for pixel, bytes_ in zip(quad_pixels(quad), read.data, strict=True):
                m.d.comb += o.payload.pixels[pixel].eq(bytes_)
            here = Signal(self.blocks, name=f"present{quad}")
            comes = Cat(self.valid[quad] & (self.block[quad] == k) for k in range(self.blocks))
            leaves = Cat(left & (left_block == k) for k in range(self.blocks))
            m.d.sync += here.eq((here & ~leaves) | comes)
            holds(m, f"place{quad}", ~(comes & here).any(), "a quad comes to a place in use")
            present.append(here)
        whole = Cat(here.bit_select(block, 1) for here in present).all()
        m.d.comb += [
            self.taken.eq(present[0] | present[1] | present[2] | present[3]),
            # A block that has just left is still present for a cycle.
            reads.eq(whole & ~(left & (left_block == block)) & (~o.valid | o.ready)),
        ]
        m.d.sync += [o.valid.eq(reads | (o.valid & ~o.ready)), left.eq(reads)]
        m.d.sync += left_block.eq(block)
        with m.If(reads):
            m.d.sync += number.eq(number + 1)
        return m
