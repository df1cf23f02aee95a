"""What the machine's parts take in cells of a library, scaled to the process of `spec.energy`."""

import numpy as np

from splatcore.sim.eda.cell_energy import CellEnergy
from splatcore.sim.eda.static_timing import Timing
from splatcore.sim.power.activity import part_around
from splatcore.sim.power.estimate import NANO, Gates
from splatcore.spec.energy import Energy


def gates_in_cells(timing: Timing, process: float, energy: Energy) -> dict[str, Gates]:
    """Parts of the machine in cells; energies scaled to 28 nm.

    process: the library's nm. Leakage does not scale: it is that of so many NAND2 by `energy`.
    """
    netlist, found = timing.netlist, CellEnergy.of(timing)
    around = [part_around(path) for path in netlist.paths]
    names = list(dict.fromkeys(around))
    number = np.array([names.index(name) for name in around])[netlist.places]
    factor = energy.scale(process, netlist.library.voltage)
    nand2 = netlist.areas / netlist.library.nand2.area
    leakage = nand2 * energy.gate_leakage * NANO
    each = nand2, netlist.is_flip_flop, factor * found.change, factor * found.clock, leakage
    sums = (np.bincount(number, values, len(names)).tolist() for values in each)
    return dict(zip(names, map(Gates._make, zip(*sums, strict=True)), strict=True))
