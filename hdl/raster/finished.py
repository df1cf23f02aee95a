"""Finished blocks of a rasterizer, until they are written to the image."""

from amaranth.hdl import Cat, Module, Signal, Value
from amaranth.lib import stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.holds import holds
from splatcore.hdl.lib.record import layout
from splatcore.spec.config import Config
from splatcore.spec.raster import block_count, nth_block, pixels_record


def nth(config: Config, number: Value) -> Value:
    """`spec.raster.nth_block` of a signal."""
    return nth_block(config, number)[: len(number)] if len(number) else number


class Finished(wiring.Component):
    """A place for each of a rasterizer's blocks of a group.

    Blocks come in any order, and leave in the order of `spec.raster.nth_block`, group after group.

    **Timing**: one block per cycle; a block can leave two cycles after it came. The memory has a
    row per block, a write port and a read port.
    """

    def __init__(self, config: Config):
        self.config, self.blocks = config, block_count(config)
        record = layout(pixels_record(config))
        ports = {
            "valid": In(1),  # a block comes; its place must be free
            "block": In(range(self.blocks)),  # its number in the group
            "pixels": In(record["pixels"].shape),  # its pixels
            "taken": Out(self.blocks),  # one bit per place: it is not free
            "o": Out(stream.Signature(record)),  # `pixels_record`
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        pixels, o = self.o.payload.pixels, self.o
        m.submodules.memory = memory = Memory(shape=pixels.shape(), depth=self.blocks, init=[])
        write, read = memory.write_port(), memory.read_port()
        number = Signal(range(self.blocks))  # of the next one to leave
        block, reads = nth(self.config, number), Signal()
        m.d.comb += [
            write.en.eq(self.valid),
            write.addr.eq(self.block),
            write.data.eq(self.pixels),
            read.en.eq(reads),
            read.addr.eq(block),
            pixels.eq(read.data),
            reads.eq(self.taken.bit_select(block, 1) & (~o.valid | o.ready)),
        ]
        m.d.sync += o.valid.eq(reads | (o.valid & ~o.ready))
        with m.If(reads):
            m.d.sync += number.eq(number + 1)
        # A place is free a cycle after its block has left: `reads` comes late.
        left, left_block = Signal(), Signal.like(number)
        m.d.sync += [left.eq(reads), left_block.eq(block)]
        comes = Cat(self._bits(self.valid, self.block))
        leaves = Cat(self._bits(left, left_block))
        m.d.sync += self.taken.eq((self.taken & ~leaves) | comes)
        holds(m, "place", ~(comes & self.taken).any(), "a finished block comes to a place in use")
        return m

    def _bits(self, valid: Value, block: Value) -> list[Value]:
        """One bit per block: it is `block`, if `valid`."""
        return [valid & (block == k) for k in range(self.blocks)]
