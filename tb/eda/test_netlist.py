"""Netlists of cells in simulation, against the golden model: the bench of each stage, with stalls."""

import re
from functools import cache

import pytest

from splatcore.eda.cells.cell_models import cell_model, simulated
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.silicon import silicon
from splatcore.sim.rtl.streams import Simulation
from tb.helpers.liberty import liberty_files
from tb.helpers.runs import marked
from tb.stages.table import STAGES

QUICK = "expand"

ON_STREAMS = tuple(list(STAGES)[:-3])
"""Stages without memory."""

LIBRARIES = [pytest.param(None, id="small")] + [
    pytest.param(file, id=file.name, marks=pytest.mark.verify) for file in liberty_files()
]


@cache
def netlist(name: str, file) -> str:
    """Verilog of a stage's netlist, with models of its cells."""
    return simulated(silicon(STAGES[name].component(), read_liberty(file)).netlist)


def check(name: str, source: str):
    """Run a stage's cases on a netlist, without and with stalls."""
    stage = STAGES[name]
    simulation = Simulation(stage.component(), source=source)
    for kind, case in stage.cases().items():
        for seed, stall in enumerate((0.0, 0.3, 0.7)):
            case.check(simulation, f"{kind}: ", stall=stall, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("file", LIBRARIES)
@pytest.mark.parametrize("name", marked(ON_STREAMS, set(ON_STREAMS) - {QUICK}))
def test_netlist_equals_golden(liberty_path, name, file):
    check(name, netlist(name, file or liberty_path))


@pytest.mark.slow
def test_a_wrong_cell_is_found(liberty_path):
    """A NAND2 that is an AND: one cell of the netlist."""
    text = netlist(QUICK, liberty_path)
    wrong = "module WRONG (input A, input B, output Y);\n  assign Y = A & B;\nendmodule\n"
    changed = re.sub(r"^  NAND2_\d+ ", "  WRONG ", text, count=1, flags=re.M)
    assert changed != text
    with pytest.raises(AssertionError):
        check(QUICK, changed + wrong)


def test_cells_without_model(library):
    """A latch has no model, nor has a function of other names."""
    cell = type(library.nand2)("L", 1.0, {"D": (0, 0)}, {"Q": "IQ"}, {"other": "latch"}, (), False,
                               (), 0.0)  # fmt: skip
    with pytest.raises(ValueError, match="L: no model"):
        cell_model(cell)
