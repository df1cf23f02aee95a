"""The Verilog that is simulated: nothing has a value before the hardware gives it one.

Amaranth writes an initial value for each register and memory, and a simulator that takes it never
sees a register that is read before a reset or a write, which in a chip holds anything. Here they
are left out; Verilator puts random bits in their place, those of the run's seed, the same ones in
all words of a memory.
"""

import re

SEEDS = (1 << 31) - 1  # numbers from which Verilator's begins, but for 0

STATE = ("--x-initial", "unique")
"""Verilator's arguments for registers and memories that begin with what the run's seed gives."""


def state_of(seed: int) -> list[str]:
    """Arguments of a run of a program of Verilator's for random registers and memories."""
    return ["+verilator+rand+reset+2", f"+verilator+seed+{1 + seed % SEEDS}"]


REGISTER = re.compile(r"^(\s*reg .+ )= \d+'h[0-9a-f]+;$", re.M)
MEMORY = re.compile(r"^  initial begin\n(?:    \S+ ?\[\d+\] = \d+'h0+;\n)+  end\n", re.M)


def without_initial(source: str) -> str:
    """Verilog of Amaranth without initial values of registers, and of memories without contents.

    Memories with contents, some word of which is not 0, keep them.
    """
    return MEMORY.sub("", REGISTER.sub(r"\1;", source))
