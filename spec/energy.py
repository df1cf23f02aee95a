"""Energy of switching, clocking and memory accesses: constants of `splatcore power`'s ESTIMATE.

They are of a 28 nm process at 0.9 V, from books and published tables as far as there are any, else
assumptions, and say so; none is fitted to a design whose power is known. A factor of two either way
is within what such numbers are good for.
"""

from dataclasses import dataclass, fields
from math import inf, sqrt

from splatcore.spec.error import InputError

PROCESS_NM = 28


@dataclass(frozen=True)
class Energy:
    """Constants of the estimate. Raises InputError, naming the field, for what none can be.

    supply: V. Nominal for 28 nm HPM and HPC processes.

    input_capacitance, output_capacitance: fF, of one input and of the output of a NAND2. About 1 fF
    for each µm of a transistor's width, in any process (Weste and Harris, CMOS VLSI Design): two
    transistors of 0.3 µm at an input, and as much in diffusion at the output. The widths are an
    assumption.

    fan_out: inputs that an output drives. An assumption: the mean of mapped netlists is 2 to 3.

    wire_capacitance: fF, of a net. 0.2 fF/µm (same book) times 5 µm, 8 times the pitch of gates in
    the paper's table (0.38 µm² for each NAND2-equivalent). The length is an assumption.

    flip_flop_capacitance: fF, charged in each cycle whether data change or not. A transmission-gate
    flip-flop has 12 transistors on its clock, two inverters included; 0.15 µm each, and 0.4 fF of
    wires and diffusion. Widths are an assumption.

    clock_tree_capacitance: fF, for each flip-flop, of wires and buffers. An assumption: 5 µm of
    wire as above.

    memory_access, memory_words, memory_bits: pJ that an access to a memory of that size takes. The
    8 KB cache, 64 bits a read, of M. Horowitz, Computing's Energy Problem, ISSCC 2014: 45 nm,
    0.9 V. Its next one, four times as large, takes twice as much: the energy goes with the root of
    the words, and with the bits. A write is assumed to cost what a read does.

    memory_scale: from there to this process: capacitance goes with the length, voltage is the same.

    dram_bit: pJ for a bit read or written, LPDDR4: device, activation of rows and both ends of the
    interface; no refresh, nothing for being idle. An assumption: round figures around 4 are quoted
    for LPDDR4 (HBM2, which is as good, has 3.9: O'Connor et al., MICRO 2017).

    gate_leakage, memory_leakage: nW of a NAND2-equivalent and of a bit of memory, warm. Assumptions
    for transistors of regular threshold; a process's corners lie a factor of ten apart.
    """

    supply: float = 0.9
    input_capacitance: float = 0.6
    output_capacitance: float = 0.6
    fan_out: float = 2.0
    wire_capacitance: float = 1.0
    flip_flop_capacitance: float = 2.2
    clock_tree_capacitance: float = 1.0
    memory_access: float = 10.0
    memory_words: int = 1024
    memory_bits: int = 64
    memory_scale: float = 28 / 45
    dram_bit: float = 4.0
    gate_leakage: float = 2.0
    memory_leakage: float = 0.02

    def __post_init__(self):
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 <= value < inf:
                raise InputError(f"energy: {field.name} {value} is not 0 or more")
            if type(value) is int and not value:
                raise InputError(f"energy: {field.name} is 0")

    @property
    def switching(self) -> float:
        """fJ for a NAND2's output to rise or to fall: half of C·V², the mean of both."""
        load = self.fan_out * self.input_capacitance + self.wire_capacitance
        return (self.output_capacitance + load) * self.supply**2 / 2

    @property
    def clock(self) -> float:
        """fJ for a flip-flop in each cycle: C·V², as its clock rises and falls."""
        return (self.flip_flop_capacitance + self.clock_tree_capacitance) * self.supply**2

    def access(self, words: int, bits: int) -> float:
        """fJ for a row of a memory to be read, or to be written."""
        size = bits / self.memory_bits * sqrt(words / self.memory_words)
        return 1000 * self.memory_access * self.memory_scale * size

    def scale(self, process: float, voltage: float) -> float:
        """What an energy becomes from a process of so many nm at a voltage to this one. ASSUMED:
        capacitances are as lengths, and an energy is C·V²."""
        return PROCESS_NM / process * (self.supply / voltage) ** 2

    @property
    def dram_byte(self) -> float:
        """pJ for a byte of DRAM to be read, or to be written."""
        return 8 * self.dram_bit


ENERGY = Energy()
"""The constants as they are stated above."""
