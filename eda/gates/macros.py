"""On-chip memories as separate modules that macros can replace."""

import re

from amaranth.hdl import ClockSignal, Instance, Module, Shape
from amaranth.lib.memory import Memory

from splatcore.eda.template import filled

PORTS = (
    "clk", "write_enable", "write_address", "write_data", "read_enable", "read_address", "read_data"
)  # fmt: skip
"""A memory's ports in order; the last one is its only output."""

PREFIX = "splatcore"
"""Default prefix of module names."""


def memory_name(words: int, bits: int, prefix: str = PREFIX) -> str:
    """Module name of a memory of that size."""
    return f"{prefix}_memory_{words}x{bits}"


def memory_size(module: str) -> tuple[int, int]:
    """Words and bits of a memory, from its module's name."""
    words, bits = map(int, re.findall(r"\d+", module)[-2:])
    return words, bits


def sizes_in(text: str, prefix: str = PREFIX) -> list[tuple[int, int]]:
    """(words, bits) of all memories in a Verilog text, each once."""
    found = re.findall(rf"\b{prefix}_memory_(\d+)x(\d+) ", text)
    return sorted({(int(words), int(bits)) for words, bits in found})


def module(words: int, bits: int, prefix: str = PREFIX, blackbox: bool = False) -> str:
    """Verilog of a memory, from which tools infer block RAM or flip-flops.

    blackbox: write only its ports
    """
    address, data = (words - 1).bit_length() - 1, bits - 1
    facts = {"name": memory_name(words, bits, prefix), "blackbox": blackbox}
    return filled("gates/memory.v", address=address, data=data, last=words - 1, **facts)


class Macros:
    """Amaranth platform that replaces each synchronous memory by an instance of a module per size.

    Such a memory has one write port and one read port, and no initial values. Memories with an
    asynchronous read port are not replaced and become flip-flops.

    prefix: of the names of the memories' modules
    sizes: (words, bits) of each replaced memory
    """

    def __init__(self, prefix: str = PREFIX):
        self.prefix, self.sizes = prefix, []

    def get_memory(self, memory: Memory):
        """Replace a memory; called by Amaranth."""
        if any(port.domain == "comb" for port in memory.read_ports):
            return memory.elaborate(None)
        size = memory.depth, Shape.cast(memory.shape).width
        (write,), (read,) = memory.write_ports, memory.read_ports
        if len(write.en) != 1 or read.transparent_for or any(memory.init):
            raise ValueError(f"memory {size}: no macro has its ports or initial values")
        self.sizes.append(size)
        m = Module()
        m.submodules.macro = Instance(
            memory_name(*size, self.prefix),
            i_clk=ClockSignal(),
            i_write_enable=write.en, i_write_address=write.addr, i_write_data=write.data,
            i_read_enable=read.en, i_read_address=read.addr, o_read_data=read.data,
        )  # fmt: skip
        return m
