"""On-chip memories as macros: what is left of them when the gates around them are synthesised."""

from amaranth.hdl import ClockSignal, Instance, Module, Shape, Value
from amaranth.lib.memory import Memory


class Macros:
    """An Amaranth platform that replaces synchronous memories by black boxes.

    Memories with an asynchronous read port stay as they are: they become flip-flops.

    sizes: (words, bits) of each memory that was replaced. library: Verilog of the black boxes.
    """

    def __init__(self):
        self.sizes: list[tuple[int, int]] = []
        self.library = ""

    def get_memory(self, memory: Memory):
        """What stands for a memory; called by Amaranth."""
        if any(port.domain == "comb" for port in memory.read_ports):
            return memory.elaborate(None)
        name = f"macro{len(self.sizes)}"
        self.sizes.append((memory.depth, Shape.cast(memory.shape).width))
        ports = {"i_clk": ClockSignal()}
        for k, port in enumerate(memory.write_ports):
            ports |= {f"i_write{k}_en": port.en, f"i_write{k}_addr": port.addr}
            ports[f"i_write{k}_data"] = port.data
        for k, port in enumerate(memory.read_ports):
            ports |= {f"i_read{k}_en": port.en, f"i_read{k}_addr": port.addr}
            ports[f"o_read{k}_data"] = port.data
        listed = []
        for port, value in ports.items():
            way = "output" if port.startswith("o_") else "input"
            listed.append(f"{way} [{len(Value.cast(value)) - 1}:0] {port[2:]}")
        self.library += f"(* blackbox *) module {name}({', '.join(listed)}); endmodule\n"
        m = Module()
        m.submodules.macro = Instance(name, **ports)
        return m
