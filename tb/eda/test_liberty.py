"""Standard-cell libraries: liberty files in several dialects; refusals. Energies of cells: a few
cells against sums computed here; totals per part of the machine."""

import gzip
from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.eda.cells.cell_energy import PICO, CellEnergy
from splatcore.eda.cells.cell_netlist import put_together
from splatcore.eda.cells.delays import fo4
from splatcore.eda.cells.liberty import evaluated
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.mapping import Mapped, mapped
from splatcore.eda.cells.static_timing import Assumed, Timing
from splatcore.eda.gates.synth import Netlist
from splatcore.eda.power.cells import gates_in_cells
from splatcore.hdl.arithmetic.add import Add
from splatcore.spec.config import TINY
from splatcore.spec.energy import Energy
from tb.helpers.command import check_refused
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
    delay,
    inside,
    liberty_files,
    needs_libraries,
    small_library,
    transition,
)


def test_contents(library):
    assert library.name == "small" and len(library.cells) == 13
    assert library.corner == "process 1, voltage 0.9 V, temperature 125 °C"
    names = library.nand2, library.inverter, library.driver, library.flip_flop
    assert [cell.name for cell in names] == ["NAND2_1", "INV_1", "BUF_4", "DFF_1"]
    nand2 = library.nand2
    assert nand2.area == 3 and nand2.inputs["B"] == (1.2 * INPUT, 1.2 * INPUT)
    tables = nand2.arcs[1].delays
    assert (nand2.arcs[1].begin, nand2.arcs[1].sense) == ("B", "negative")
    assert tables[0].values[1, 2] == pytest.approx(delay(0.1, 0.1, 1.2))


@pytest.mark.parametrize("changes", [{"time": "1ps"}, {"swapped": True}])
def test_units_and_axes(library, tmp_path, changes):
    """The same library in other units or with swapped axes, gzipped, reads the same."""
    file = tmp_path / "other.lib.gz"
    file.write_bytes(gzip.compress(small_library(**changes).encode()))
    other = read_liberty(file)
    for name, cell in library.cells.items():
        for one, another in zip(tables(cell), tables(other.cells[name]), strict=True):
            for field in ("slews", "loads", "values"):
                assert np.allclose(getattr(one, field), getattr(another, field))


def tables(cell) -> list:
    """All tables of a cell."""
    times = [table for arc in cell.arcs for table in arc.delays + arc.slews]
    return times + [table for inside in cell.inside for table in inside.energies]


def test_fo4_is_an_inverter_with_four_as_load(library):
    slew = transition(4 * INPUT)
    assert fo4(library) == pytest.approx(delay(slew, 4 * INPUT))


@pytest.mark.parametrize("function", ["!(A B)", "(A*B)'", "!A | !B", "(!A)+(!B)"])
def test_functions(liberty_path, tmp_path, function):
    """A NAND2 is recognised however its function is written."""
    file = tmp_path / "a.lib"
    file.write_text(liberty_path.read_text().replace("!(A*B)", function))
    assert read_liberty(file).nand2.name == "NAND2_1"


REFUSED = {
    "none.lib": "none.lib: No such file",
    "text.lib": "text.lib: not a liberty file",
    "cut.lib": "cut.lib: not a liberty file.*ends within a group",
    "cut.lib.gz": "cut.lib.gz: not a liberty file",
    "nand2.lib": "nand2.lib: the library has no cell that is a NAND2",
    "dff.lib": "dff.lib: the library has no cell that is a flip-flop",
    ".": "\\.: Is a directory",
}


@pytest.mark.parametrize("file", REFUSED)
def test_refused(tmp_path, monkeypatch, capsys, file):
    monkeypatch.chdir(tmp_path)
    text = small_library()
    texts = {"text.lib": "hello\n", "cut.lib": text[:900]}
    texts |= {f"{n}.lib": small_library(leave_out=(n.upper(),)) for n in ("nand2", "dff")}
    for name, content in texts.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "cut.lib.gz").write_bytes(gzip.compress(text.encode())[:500])
    check_refused(capsys, f"synth --stage add --liberty {file} -o out", REFUSED[file])
    assert not (tmp_path / "out").exists()


@needs_libraries
@pytest.mark.verify
@pytest.mark.parametrize("file", liberty_files(), ids=lambda file: file.name)
def test_users_libraries(file):
    """A user's library has a plausible FO4, and an adder can be mapped and timed."""
    library = read_liberty(file)
    assert 0.003 < fo4(library) < 0.2
    found = mapped(Netlist.of(Add(TINY.arithmetic, TINY.add_latency)), library)
    assert Timing(put_together(library, {"": found}), Assumed.of(library)).longest.time > 0


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
