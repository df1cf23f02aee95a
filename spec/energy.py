"""Energy of switching, clocking and memory accesses: constants of `splatcore power`'s ESTIMATE.

They describe a 28 nm process at 0.9 V, from books and published tables if available. All others are
assumptions and are marked so; none is fitted to a design of known power. Expect errors up to a
factor of two either way.
"""

from dataclasses import dataclass, fields
from math import inf, sqrt

from splatcore.spec.error import InputError

PROCESS_NM = 28
"""Process of the constants, nm."""


@dataclass(frozen=True)
class Energy:
    """Constants of the estimate. Raises InputError, naming the field, for impossible values.

    supply: V. Nominal for 28 nm HPM and HPC processes.

    input_capacitance, output_capacitance: fF per input, and per output, of a NAND2. About 1 fF per
    µm of transistor width, in any process (Weste and Harris, CMOS VLSI Design): two transistors of
    0.3 µm at an input, and the same in diffusion at the output. The widths are an assumption.

    fan_out: inputs per output. An assumption: the mean of mapped netlists is 2 to 3.

    wire_capacitance: fF per net. 0.2 fF/µm (same book) times 5 µm, 8 times the pitch of gates in
    the paper's table (0.38 µm² per NAND2-equivalent). The length is an assumption.

    flip_flop_capacitance: fF per flip-flop, charged in each cycle even if data do not change. A
    transmission-gate flip-flop has 12 transistors on its clock, two inverters included; 0.15 µm
    each, and 0.4 fF of wires and diffusion. The widths are an assumption.

    clock_tree_capacitance: fF of wires and buffers per flip-flop. An assumption: 5 µm of wire as
    above.

    memory_access, memory_words, memory_bits: pJ per access to a memory of that size. The 8 KB
    cache, 64 bits per read, of M. Horowitz, Computing's Energy Problem, ISSCC 2014: 45 nm, 0.9 V.
    Its next larger cache, four times the size, takes twice the energy: energy goes with the root
    of the words, and with the bits. A write is assumed to cost the same as a read.

    memory_scale: from 45 nm to this process: capacitance goes with length, the voltage is the same.

    dram_bit: pJ per bit read or written, LPDDR4: device, activation of rows and both ends of the
    interface; no refresh, no idle power. An assumption: round figures around 4 are quoted for
    LPDDR4 (HBM2, about as good, has 3.9: O'Connor et al., MICRO 2017).

    gate_leakage, memory_leakage: nW per NAND2-equivalent, and per bit of memory, warm. Assumptions
    for transistors of regular threshold; a process's corners differ by a factor of ten.
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
        """fJ per rise or fall of a NAND2's output: half of C·V², the mean of both."""
        load = self.fan_out * self.input_capacitance + self.wire_capacitance
        return (self.output_capacitance + load) * self.supply**2 / 2

    @property
    def clock(self) -> float:
        """fJ per flip-flop and cycle: C·V², as its clock rises and falls."""
        return (self.flip_flop_capacitance + self.clock_tree_capacitance) * self.supply**2

    def access(self, words: int, bits: int) -> float:
        """Return the fJ per read or write of a memory with `words` rows of `bits`."""
        size = bits / self.memory_bits * sqrt(words / self.memory_words)
        return 1000 * self.memory_access * self.memory_scale * size

    def scale(self, process: float, voltage: float) -> float:
        """Return the factor by which an energy changes when it is scaled to this process.

        process: its process, nm
        voltage: its supply, V
        ASSUMED: capacitances go with lengths, and an energy is C·V².
        """
        return PROCESS_NM / process * (self.supply / voltage) ** 2

    @property
    def dram_byte(self) -> float:
        """pJ per byte of DRAM read or written."""
        return 8 * self.dram_bit


ENERGY = Energy()
"""The constants as stated above."""
