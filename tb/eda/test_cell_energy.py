"""Energies of cells: a few cells against sums computed here; totals per part of the machine."""

from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.eda.cells.cell_energy import PICO, CellEnergy
from splatcore.eda.cells.cell_netlist import put_together
from splatcore.eda.cells.liberty import evaluated
from splatcore.eda.cells.mapping import Mapped
from splatcore.eda.cells.static_timing import Assumed, Timing
from splatcore.eda.power.cells import gates_in_cells
from splatcore.spec.energy import Energy
from tb.helpers.liberty import (
    AREA_FF,
    CLOCK,
    DATA,
    FALL,
    GATES,
    INPUT,
    LEAKAGE,
    RISE,
    VOLTS,
    inside,
    transition,
)

ENERGY = Energy(supply=1.8, gate_leakage=5.0)

CELLS = [("DFF_1", "a", [9, 5, 2]), ("NAND2_1", "n", [2, 2, 4]), ("INV_1", "i", [4, 5])]
"""A flip-flop, a NAND2 whose inputs it both drives, and an inverter back to its input."""


def timed(library, pieces) -> Timing:
    netlist = put_together(library, pieces)
    return Timing(netlist, Assumed.of(library))


def test_energies_of_three_cells(library):
    """Table energy by slew and load, net capacitance, clock energy of an idle register, leakage."""
    timing = timed(library, {"": Mapped(CELLS, [], [("clk", "input", [9])], {})})
    found = CellEnergy.of(timing)
    loads = 2 * 1.2 * INPUT, INPUT, DATA
    slews = 0.0, transition(loads[0]), transition(loads[1])
    efforts = 1.0, 1.2, 1.0
    expected = [
        inside(slew, load, effort) + load * VOLTS**2 / 2
        for slew, load, effort in zip(slews, loads, efforts, strict=True)
    ]
    np.testing.assert_allclose(found.change, PICO * np.array(expected))
    clock = RISE + FALL + CLOCK * VOLTS**2
    np.testing.assert_allclose(found.clock, PICO * np.array([clock, 0, 0]))
    areas = np.array([AREA_FF, GATES["NAND2"][2], GATES["INV"][2]])
    np.testing.assert_allclose(found.leakage, LEAKAGE * 1e-9 * areas)


def test_parts_of_the_machine(library):
    """Each cell counts for the part of its block; energies scale with the process, leakage not."""
    cull = "preprocess.points.cull"
    part = Mapped([CELLS[1]], [], [("i", "input", [2]), ("o", "output", [4])], {})
    blocks = [("cull", cull, [[2], [4]])]
    whole = Mapped([CELLS[0], CELLS[2]], blocks, [("clk", "input", [9])], {})
    timing = timed(library, {"": whole, cull: part})
    found = CellEnergy.of(timing)
    gates = gates_in_cells(timing, 56, ENERGY)
    factor = ENERGY.scale(56, VOLTS)
    assert factor == pytest.approx(0.5 * 4) and list(gates) == ["top, the rest", "cull"]
    rest, cull = gates.values()
    assert (rest.flip_flops, cull.flip_flops, cull.nand2) == (1, 0, 1)
    assert rest.nand2 == pytest.approx((AREA_FF + GATES["INV"][2]) / GATES["NAND2"][2])
    assert rest.change == pytest.approx(factor * found.change[:2].sum())
    assert cull.change == pytest.approx(factor * found.change[2])
    assert (rest.clock, cull.clock) == (pytest.approx(factor * found.clock.sum()), 0)
    assert cull.leakage == pytest.approx(5e-9)


FORCED = {"clear": "!R", "preset": "S", "variable": "IQ"}


@pytest.mark.parametrize(
    "state, rests",
    [
        ("", True), ("D*Q*!N", True), ("!D * !Q * N", True), ("D*!Q", False), ("Q*N", False),
        ("!R", False), ("S D", False), ("C*D", True), ("VDD*D", True),
    ],
)  # fmt: skip
def test_states_of_a_flip_flop_that_stays(library, state, rests):
    """Whether a state keeps a flip-flop's value, with both outputs, a clear and a preset."""
    kind = type(library.flip_flop)
    cell = SimpleNamespace(
        inputs=dict.fromkeys("CDRS"), functions={"Q": "IQ", "N": "IQN"}, state=FORCED, data="D"
    )
    assert kind.rests_in(cell, state) == rests


def test_truth_tables_with_constants():
    assert evaluated("A*1", ["A"]) == [0, 1] and evaluated("A*B", ["A"]) == []
