"""Netlists of cells against the golden model, in the bench of each stage with stalls; proofs that
netlist and RTL are equivalent."""

import re
from functools import cache

import pytest

from splatcore.eda.cells.cell_models import cell_model, simulated
from splatcore.eda.cells.equivalence import DifferenceError, prove
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.opensta import verilog
from splatcore.eda.cells.silicon import silicon
from splatcore.eda.gates.synth import Netlist
from splatcore.hdl.sorting.merge import Merge
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import TINY
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
    with pytest.raises(AssertionError):
        check(QUICK, with_and(text) + wrong)


def with_and(text: str) -> str:
    """A netlist with the module WRONG in place of its first NAND2."""
    changed = re.sub(r"^  NAND2_\d+ ", "  WRONG ", text, count=1, flags=re.M)
    assert changed != text
    return changed


@pytest.mark.slow
def test_proof_of_equivalence(library):
    """The merge of runs is proven, and not with an AND in place of a NAND2."""
    rtl = Netlist.of(Merge(TINY))
    netlist = silicon(Merge(TINY), library)
    text = verilog(netlist.netlist, "top")
    proof = prove(rtl, text, library)
    assert proof.registers == netlist.facts["flip_flops"] and proof.points > proof.registers
    wrong = with_and(text) + "module WRONG (input A, input B, output Y);\n  assign Y = A & B;\n"
    with pytest.raises(DifferenceError, match="of 333 bits differ"):
        prove(rtl, wrong + "endmodule\n", library)


def test_cells_without_model(library):
    """A latch has no model, nor has a function of other names."""
    cell = type(library.nand2)("L", 1.0, {"D": (0, 0)}, {"Q": "IQ"}, {"other": "latch"}, (), False,
                               (), 0.0)  # fmt: skip
    with pytest.raises(ValueError, match="L: no model"):
        cell_model(cell)
