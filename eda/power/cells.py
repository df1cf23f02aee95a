"""Energy of the machine's parts: as plain gates, or in cells of a library, scaled to 28 nm."""

from collections.abc import Callable

import numpy as np

from splatcore.eda.cells.cell_energy import CellEnergy
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.silicon import machine_silicon
from splatcore.eda.cells.static_timing import Timing
from splatcore.eda.gates.machine_gates import netlist, part_around, sizes
from splatcore.eda.power.estimate import NANO, Gates, gates_of
from splatcore.spec.config import Config
from splatcore.spec.energy import Energy


def gates_in_cells(timing: Timing, process: float, energy: Energy) -> dict[str, Gates]:
    """Parts of the machine in library cells, with energies scaled to 28 nm.

    process: the library's process, nm
    energy: its leakage per NAND2-equivalent is used, as the library's does not scale
    """
    cells, found = timing.netlist, CellEnergy.of(timing)
    around = [part_around(path) for path in cells.paths]
    names = list(dict.fromkeys(around))
    number = np.array([names.index(name) for name in around])[cells.places]
    factor = energy.scale(process, cells.library.voltage)
    nand2 = cells.areas / cells.library.nand2.area
    leakage = nand2 * energy.gate_leakage * NANO
    is_gate = cells.is_clock_gate
    each = (
        nand2, cells.is_flip_flop, factor * found.change, factor * found.clock * ~is_gate,
        factor * found.clock * is_gate, leakage,
    )  # fmt: skip
    sums = (np.bincount(number, values, len(names)).tolist() for values in each)
    return dict(zip(names, map(Gates._make, zip(*sums, strict=True)), strict=True))


def machine_gates(
    config: Config, library: Library | None, process: float | None, advance: Callable[..., None]
) -> dict[str, Gates]:
    """Parts of the machine, in cells of a library or, without one, in plain gates.

    process: the library's process, nm
    advance: called with the progress of synthesis
    """
    hierarchy = netlist(config)
    if library is None:
        return gates_of(sizes(hierarchy, advance), config.energy)
    _, silicon = machine_silicon(hierarchy, library, advance)
    return gates_in_cells(silicon.wired, process, config.energy)
