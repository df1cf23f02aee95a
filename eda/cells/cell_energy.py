"""Energy of library cells in a netlist: of changes, of the clock, and leakage.

A change takes the energy in its cell's tables, by input slew and load, and half of C·V² of the net.
If a library has several states, the energy is their mean. A flip-flop's clock counts only states in
which the flip-flop keeps its value: the energy of a new value belongs to its output. A clock gate
takes the energy of an open one in each cycle.
"""

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from splatcore.eda.cells.delays import looked_up
from splatcore.eda.cells.liberty import Inside
from splatcore.eda.cells.static_timing import Timing

PICO = 1e-12


@dataclass(frozen=True)
class CellEnergy:
    """Energy of each cell of a netlist.

    change: J if each of its pins changes once, including the loads of its outputs
    clock: J per clock period, of flip-flops and clock gates
    leakage: W
    """

    change: np.ndarray
    clock: np.ndarray
    leakage: np.ndarray

    @classmethod
    def of(cls, timing: Timing) -> "CellEnergy":
        """Compute the energies with the slews and loads of a timing."""
        netlist = timing.netlist
        volts = netlist.library.voltage
        change, clock, leakage = np.zeros((3, len(netlist.kinds)))
        for cell, cells, nets in netlist.by_kind():
            leakage[cells] = cell.leakage
            for pin in cell.functions:
                change[cells] += timing.load[nets[pin]].mean(axis=1) * volts**2 / 2
            for pin, found in groupby(cell.inside, key=lambda each: each.pin):
                if cell.is_clock_gate and pin != cell.data:
                    clock[cells] += 2 * _mean(timing, list(found), nets)
                elif cell.is_flip_flop and pin == cell.clock:
                    resting = [each for each in found if cell.rests_in(each.condition)]
                    clock[cells] += 2 * _mean(timing, resting, nets)
                else:
                    change[cells] += _mean(timing, list(found), nets)
            if cell.is_clocked:
                clock[cells] += sum(cell.inputs[cell.clock]) / 2 * volts**2
        return cls(PICO * change, PICO * clock, leakage)


def _mean(timing: Timing, found: list[Inside], nets: dict[str, np.ndarray]) -> np.ndarray | float:
    """pJ per change at a pin, the mean of its edges, causes and states; entries for given states
    replace the one for all other states."""
    found = [each for each in found if each.condition] or found
    each = [_energy(timing, inside, nets) for inside in found]
    return sum(each) / len(each) if each else 0.0


def _energy(timing: Timing, inside: Inside, nets: dict[str, np.ndarray]) -> np.ndarray | float:
    """pJ per change for one cause in one state. The clock has no slew."""
    slew = timing.slew[nets[inside.begin or inside.pin]].mean(axis=1)
    load = timing.load[nets[inside.pin]]
    edges = [
        looked_up(table, slew, load[:, edge]) for edge, table in enumerate(inside.energies) if table
    ]
    return sum(edges) / len(edges)
