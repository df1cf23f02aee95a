"""Wires of nets between parts before a layout: an assumed length, and a repeater."""

from dataclasses import dataclass

import numpy as np

from splatcore.eda.cells.cell_netlist import CellNetlist
from splatcore.eda.cells.delays import Arcs
from splatcore.eda.cells.liberty import Arc, Library

SIDE_SHARE = 0.5
"""Length of a net between parts, in sides of a square with the area of the cells of the parts that
it joins. ASSUMED, as the machine has no floorplan."""

WIRE_PF, WIRE_OHM = 9.2e-5, 0.515
"""Capacitance and resistance per µm of wires between parts: those of SG13G2's layers 2 to 5 in its
LEF file, at their smallest width, without neighbours. ASSUMED for all libraries."""


@dataclass(frozen=True)
class Repeater:
    """The buffer at the beginning of each net between parts.

    load: pF of its input, by edge
    arc: its timing arc
    """

    load: np.ndarray
    arc: Arc

    @classmethod
    def of(cls, library: Library, slew: float) -> "Repeater":
        """The buffer that drives 1 mm of wire soonest, its own input being driven by the library's
        `driver`. slew: of the inputs in ns."""
        buffers = [cell for cell in library.usable if cell.computes(0, 1)]
        arcs = Arcs(buffers)
        (first,) = (arc for arc in library.driver.arcs if not arc.kind)

        def time(repeater: "Repeater") -> float:
            before = Arcs([library.driver]).delay(first, 0, slew, repeater.load[0])
            return before[0] + arcs.delay(repeater.arc, 0, before[1], 1000 * WIRE_PF)[0]

        found = [
            cls(np.array(load), next(arc for arc in cell.arcs if not arc.kind))
            for cell in buffers
            for load in cell.inputs.values()
        ]
        return min(found, key=time)


def lengths_between(netlist: CellNetlist) -> np.ndarray:
    """µm of each net [nets] between parts; 0 for nets within a part, constants and the clock."""
    areas = np.bincount(netlist.places, netlist.areas, len(netlist.paths))
    pairs = np.stack([netlist.pins.ravel(), np.repeat(netlist.places, netlist.pins.shape[1])])
    nets, places = np.unique(pairs, axis=1)
    joined = np.bincount(nets, minlength=netlist.nets) > 1
    length = SIDE_SHARE * np.sqrt(np.bincount(nets, areas[places], netlist.nets))
    clock = [int(port.nets[0]) for port in netlist.ports if port.name == "clk"]
    joined[[0, 1, *clock]] = False
    return np.where(joined, length, 0.0)
