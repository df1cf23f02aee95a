"""Verilog for simulation: registers and memories without initial values.

Amaranth writes an initial value for each register and memory. A simulator that uses them hides
registers that are read before a reset or a write, which hold any value in a chip. So they are
removed; Verilator fills in random bits from the run's seed, the same in all words of a memory.
"""

import re

SEEDS = (1 << 31) - 1  # number of Verilator's seeds, without 0

STATE = ("--x-initial", "unique")
"""Verilator's arguments for random initial registers and memories."""


def state_of(seed: int) -> list[str]:
    """Arguments of a Verilator program for random registers and memories by a seed."""
    return ["+verilator+rand+reset+2", f"+verilator+seed+{1 + seed % SEEDS}"]


REGISTER = re.compile(r"^(\s*reg .+ )= \d+'h[0-9a-f]+;$", re.M)
MEMORY = re.compile(r"^  initial begin\n(?:    \S+ ?\[\d+\] = \d+'h0+;\n)+  end\n", re.M)


def without_initial(source: str) -> str:
    """Remove initial values of registers and of all-zero memories from Amaranth's Verilog.

    Memories with a word that is not 0 keep their contents.
    """
    return MEMORY.sub("", REGISTER.sub(r"\1;", source))
