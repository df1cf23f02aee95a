"""Made-up counts and gates of two parts of the machine, for tests of power."""

from splatcore.eda.gates.machine_gates import PARTS, Size
from splatcore.eda.power.activity import Accesses, Activity, Counts, Register
from splatcore.eda.power.clocks import Clocked
from splatcore.eda.power.estimate import Gates
from splatcore.spec.energy import Energy

UNIT = Energy(
    supply=2.0, input_capacitance=1.0, output_capacitance=1.0, fan_out=2.0, wire_capacitance=2.0,
    flip_flop_capacitance=0.5, clock_tree_capacitance=0.25, memory_access=1.0, memory_words=64,
    memory_bits=8, memory_scale=0.5, dram_bit=0.25, gate_leakage=4.0, memory_leakage=0.5,
)  # fmt: skip
"""10 fJ per change, 3 fJ per clock, 2 pJ per byte of DRAM."""

ACTIVITY = {"axi": Activity(200, 800.0, 20), "cull": Activity(10, 50.0, 0)}

REGISTERS = {
    "axi.full": Register("axi", 2, [0.5], 10.0),
    "axi.kept": Register("axi", 1, [1.0], 0.0),
}

COUNTS = Counts(
    ACTIVITY, REGISTERS, [Accesses("a.b", "cull", 256, 16, 30.0, 20.0)], cycles=1000, pixels=48,
    sample_every=2, simulated=4000, counted=2000, traffic={"read_model": 64, "write_pixels": 36},
)  # fmt: skip

GATES = {
    "axi": Gates(1000.0, 70, 10_000e-15, 210e-15, 6e-15, 4000e-9),
    "cull": Gates(500.0, 20, 5000e-15, 60e-15, 0.0, 2000e-9),
}
"""Energies by `UNIT`."""

CLOCKS = {"axi": Clocked(70, 40, 2, 35.0), "cull": Clocked(20, 0, 0, 20.0)}
"""Half of the flip-flops of `axi` are clocked in a cycle."""

SIZES = [
    Size(part, 1, GATES[name].nand2, 9, 8.0, 7, GATES[name].flip_flops, CLOCKS[name].gates, 0, ())
    for part in PARTS if (name := part.name) in GATES
]  # fmt: skip
