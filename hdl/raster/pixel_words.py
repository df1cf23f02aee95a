"""The lanes' memories: a word for each pixel of each block."""

from amaranth.hdl import Module, ShapeLike
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out


class PixelWords(wiring.Component):
    """A memory per pixel of a block, each with enables and addresses of its own.

    Parameters:
        shape: of a word
        blocks: number of blocks, the depth of each memory
        pixels: pixels per block
        joint: one memory for all pixels, with the enables and addresses of the first one

    **Timing**: one read and one write per cycle and pixel, not of the same word; `found` is valid a
    cycle later and holds until the pixel's next read.
    """

    def __init__(self, shape: ShapeLike, blocks: int, pixels: int, *, joint: bool = False):
        self.shape, self.blocks = shape, blocks
        self.each = pixels if joint else 1  # pixels per memory
        block = range(blocks)
        read = data.StructLayout({"enable": 1, "block": block})
        write = data.StructLayout({"enable": 1, "block": block, "word": shape})
        ports = {
            "read": In(data.ArrayLayout(read, pixels)),  # words to be read
            "found": Out(data.ArrayLayout(shape, pixels)),  # words read last
            "write": In(data.ArrayLayout(write, pixels)),  # words to be written
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        words = data.ArrayLayout(self.shape, self.each)
        for first in range(0, len(self.read), self.each):
            memory = Memory(shape=words, depth=self.blocks, init=[])
            m.submodules[f"pixel{first}"] = memory
            from_, to = memory.read_port(), memory.write_port()
            read, write = self.read[first], self.write[first]
            m.d.comb += [
                from_.en.eq(read.enable),
                from_.addr.eq(read.block),
                to.en.eq(write.enable),
                to.addr.eq(write.block),
            ]
            for k in range(self.each):
                m.d.comb += self.found[first + k].eq(from_.data[k])
                m.d.comb += to.data[k].eq(self.write[first + k].word)
        return m
