"""Netlists of cells against the golden model, in the bench of each stage with stalls; proofs that
netlist and RTL are equivalent."""

import re
from functools import cache, partial

import numpy as np
import pytest
from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import data, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from splatcore.eda.cells import checked
from splatcore.eda.cells.cell_models import cell_model, simulated
from splatcore.eda.cells.cell_netlist import put_together
from splatcore.eda.cells.equivalence import prove
from splatcore.eda.cells.exhaustive import always_zero
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.logic import DifferenceError
from splatcore.eda.cells.mapping import mapped
from splatcore.eda.cells.opensta import verilog
from splatcore.eda.cells.silicon import silicon
from splatcore.eda.cells.silicon_tables import PARTS
from splatcore.eda.gates.synth import Netlist
from splatcore.hdl.sorting.deal import Deal
from splatcore.hdl.sorting.merge import Merge
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import DEFAULT, TINY
from tb.helpers.command import check_documented, load, run
from tb.helpers.liberty import liberty_files
from tb.helpers.runs import marked
from tb.stages.sorting import deal_case, spill_kinds
from tb.stages.table import STAGES, Stage

QUICK = "expand"

DEAL = {"deal": Stage(partial(Deal, TINY), partial(spill_kinds, deal_case))}
ON_STREAMS = {name: STAGES[name] for name in list(STAGES)[:-3] if name != "spill"} | DEAL
"""Stages without memory; for the one with scratch memory, dealing alone."""

LIBRARIES = [pytest.param(None, id="small")] + [
    pytest.param(file, id=file.name, marks=pytest.mark.verify) for file in liberty_files()
]


@cache
def netlist(name: str, file) -> str:
    """Verilog of a stage's netlist, with models of its cells: mapped in one of the ways."""
    library = read_liberty(file)
    piece = mapped(Netlist.of(ON_STREAMS[name].component()), library, effort=(1, 8))
    return simulated(put_together(library, {"": piece}))


def check(name: str, source: str):
    """Run a stage's cases on a netlist, without and with stalls."""
    stage = ON_STREAMS[name]
    simulation = Simulation(stage.component(), source=source)
    for kind, case in stage.cases().items():
        for seed, stall in enumerate((0.0, 0.3, 0.7)):
            case.check(simulation, f"{kind}: ", stall=stall, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("file", LIBRARIES)
@pytest.mark.parametrize("name", marked(ON_STREAMS, ON_STREAMS.keys() - {QUICK}))
def test_netlist_equals_golden(liberty_path, name, file):
    check(name, netlist(name, file or liberty_path))


@pytest.mark.slow
def test_a_wrong_cell_is_found(liberty_path):
    """A NAND2 that is an AND: one cell of the netlist."""
    text = netlist(QUICK, liberty_path)
    wrong = re.sub(r"= ~(\([^|^;]+&[^|^;]+\);)", r"= \1", text, count=1)
    assert wrong != text
    with pytest.raises(AssertionError):
        check(QUICK, wrong)


def with_and(text: str) -> str:
    """A netlist with the module WRONG in place of its first NAND2."""
    changed = re.sub(r"^  NAND2_\d+ ", "  WRONG ", text, count=1, flags=re.M)
    assert changed != text
    return changed


WRONG = "module WRONG (input A, input B, output Y);\n  assign Y = A & B;\nendmodule\n"


@pytest.mark.slow
def test_proof_of_equivalence(library):
    """The merge of runs is proven, and not with an AND in place of a NAND2."""
    rtl = Netlist.of(Merge(TINY))
    netlist = silicon(Merge(TINY), library)
    text = verilog(netlist.netlist, "top")
    proof = prove(rtl, text, library)
    assert proof.registers == netlist.facts["flip_flops"] and proof.bits > proof.registers
    with pytest.raises(DifferenceError, match="of 334 bits are not proven equal: "):
        prove(rtl, with_and(text) + WRONG, library)


PROVEN = [
    (config, name, file)
    for config, names, files in (
        (TINY, ("add", "merge", "sub_sorter"), [None, *liberty_files()]),
        (TINY, ("multiply", "chunk", "cull", "place", "evaluate", "lane"), [None]),
        (DEFAULT, ("sub_sorter", "merge", "cull", "evaluate", "lane"), [None]),
    )
    for name in names
    for file in files
]
"""Machines, parts and libraries; None is the small one."""


@pytest.mark.verify
@pytest.mark.parametrize(
    ("config", "name", "file"), PROVEN, ids=lambda each: getattr(each, "name", each or "small")
)
def test_proofs_of_parts(liberty_path, config, name, file):
    library, component = read_liberty(file or liberty_path), partial(PARTS[name], config)
    netlist = silicon(component(), library)
    proof = prove(Netlist.of(component()), verilog(netlist.netlist, "top"), library)
    assert proof.registers == netlist.facts["flip_flops"]


class Sums(wiring.Component):
    """A product and a sum of five operands."""

    a: In(8)
    b: In(8)
    c: In(data.ArrayLayout(20, 5))
    product: Out(16)
    sum: Out(23)

    def elaborate(self, platform) -> Module:
        m = Module()
        m.d.sync += [self.product.eq(self.a * self.b), self.sum.eq(sum(self.c))]
        return m


@pytest.mark.verify
def test_proof_of_sums(library):
    """Bits that need all values of their inputs, or sums as in synthesis; not with a wrong cell."""
    rtl = Netlist.of(Sums())
    text = verilog(put_together(library, {"": mapped(rtl, library, "-booth", (1, 8))}), "top")
    proof = prove(rtl, text, library)
    assert proof.bits == 2 * proof.registers and proof.tried and proof.formed
    with pytest.raises(DifferenceError, match="are not proven equal: "):
        prove(rtl, with_and(text) + WRONG, library)


def test_all_values_are_tried():
    """An output that is 1 for one pattern of 20 inputs, and one that never is."""
    inputs = [f"i{k}" for k in range(20)]
    text = "\n".join([
        ".model m", f".names {' '.join(inputs)} \\\n all", f"{'1' * 20} 1",
        ".names all o0", "1 1", ".names all i3 o1", "10 1", ".names o1 o2", "0 1", ".end\n",
    ])  # fmt: skip
    assert always_zero(text, ["o0", "o1", "o2"]) == {"o1"}


class Held(wiring.Component):
    """A register with an enable."""

    d: In(1)
    on: In(1)
    q: Out(1, init=1)

    def elaborate(self, platform) -> Module:
        m = Module()
        with m.If(self.on):
            m.d.sync += self.q.eq(self.d)
        return m


GATE = """
  cell (CG) {
    area : 4;
    clock_gating_integrated_cell : "latch_posedge";
    statetable ("C E", "int") { table : "L L : - : L , L H : - : H , H - : - : N"; }
    pin (C) { direction : input; clock_gate_clock_pin : true; }
    pin (E) { direction : input; clock_gate_enable_pin : true; }
    pin (int) { direction : internal; internal_node : "int"; }
    pin (G) { direction : output; clock_gate_out_pin : true; state_function : "C * int"; }
  }
}
"""

GATED = """
module top (clk, rst, d, on, q);
  input clk;
  input rst;
  input d;
  input on;
  output q;
  wire off, live, enable, low, next, gated;
  INV_1 u0 (.A(on), .Y(off));
  INV_1 u1 (.A(rst), .Y(live));
  NAND2_1 u2 (.A(off), .B(live), .Y(enable));
  INV_1 u3 (.A(d), .Y(low));
  NAND2_1 u4 (.A(low), .B(live), .Y(next));
  CG u5 (.C(clk), .E(enable), .G(gated));
  DFF_1 q_reg (.CK(gated), .D(next), .Q(q));
endmodule
"""


@pytest.mark.slow
@pytest.mark.parametrize("enable", ["enable", "live"])
def test_clock_gates(liberty_path, tmp_path, enable):
    """A register behind a clock gate equals one with an enable, unless the gate opens at other
    times: proof and simulation."""
    file = tmp_path / "gate.lib"
    file.write_text(liberty_path.read_text().rstrip().removesuffix("}") + GATE)
    library, text = read_liberty(file), GATED.replace(".E(enable)", f".E({enable})")
    kinds = ("INV_1", "NAND2_1", "DFF_1", "CG")
    models = [cell_model(library.cells[kind]) for kind in kinds]
    values = np.random.default_rng(1).integers(0, 2, (2, 200))
    given = dict(zip(("d", "on"), values, strict=True))
    right, found = (
        Simulation(Held(), ("q",), source).run({}, constants=given, cycles_max=200).samples["q"]
        for source in (None, "\n".join([text, *models]))
    )
    if enable == "enable":
        assert prove(Netlist.of(Held()), text, library).registers == 1
        assert (right == found).all() and 0 < right.sum() < 200
    else:
        with pytest.raises(DifferenceError, match="1 of 2 bits are not proven equal: q_reg'"):
            prove(Netlist.of(Held()), text, library)
        assert (right != found).any()


class Words(wiring.Component):
    """Words in flip-flops, read in turn: beyond the last one a word is undefined. Two registers
    have equal inputs; one is 1 from its second cycle on."""

    i: In(2)
    o: Out(5)

    def __init__(self, turns: int):
        super().__init__()
        self.turns = turns

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.storage = storage = Memory(shape=2, depth=5, init=[])
        write, read = storage.write_port(), storage.read_port(domain="comb")
        place, one, other, later = Signal(3), Signal(2), Signal(2), Signal()
        m.d.comb += [write.addr.eq(place), write.data.eq(self.i), write.en.eq(1)]
        m.d.comb += [read.addr.eq(place), self.o.eq(Cat(read.data ^ one, other, later))]
        m.d.sync += [place.eq(Mux(place == self.turns - 1, 0, place + 1))]
        m.d.sync += [one.eq(self.i + 1), other.eq(self.i + 1), later.eq(1)]
        return m


def test_undefined_words(library):
    """Words beyond the end must never be read: an address that stays below the end is proven, and
    one register stands for two. If the address goes further, nothing is assumed. A register that is
    1 from its second cycle on must not be 0."""
    for turns in (5, 6):
        rtl = Netlist.of(Words(turns))
        text = verilog(silicon(Words(turns), library).netlist, "top")
        if turns == 5:
            assert prove(rtl, text, library).left_out == 2
            stays_0 = re.sub(r"\.D\(\w+\)(, \.Q\(o\[4\]\))", r".D(1'b0)\1", text)
            assert stays_0 != text
            with pytest.raises(
                DifferenceError, match=r"1 of \d+ bits are not proven equal: o\[4\]'"
            ):
                prove(rtl, stays_0, library)
        else:
            with pytest.raises(DifferenceError, match="are not proven equal: "):
                prove(rtl, text, library)


def test_a_wrong_clock(library):
    """A flip-flop on another clock than the port's."""
    text = verilog(silicon(Words(5), library).netlist, "top")
    wrong = text.replace(".CK(clk)", ".CK(i[0])", 1)
    assert wrong != text
    with pytest.raises(DifferenceError, match="1 clocks are not the port clk"):
        prove(Netlist.of(Words(5)), wrong, library)


@pytest.mark.slow
def test_command(liberty_path, tmp_path, monkeypatch, capsys):
    """A line per part and one for all; exit status 1 if a cell is wrong."""
    monkeypatch.chdir(tmp_path)
    words = "synth", "--stage", "add", "--preset", "tiny", "--liberty", liberty_path, "--check"
    assert run(*words, "--json", "s.json") == 0
    found = load(tmp_path / "s.json")["check"]["add"]
    check_documented("`splatcore synth --liberty`", list(found))
    assert found["bits"] > found["registers"] > 0 and found["difference"] is None
    assert "Netlists proven equivalent to their RTL: 1 of 1." in capsys.readouterr().out

    monkeypatch.setattr(checked, "verilog", lambda *given: with_and(verilog(*given)) + WRONG)
    assert run(*words) == 1
    printed = capsys.readouterr()
    assert re.search(r"add: \d+ of 128 bits are not proven equal: \S+", printed.err)
    assert "RTL: 0 of 1." in printed.out


def test_cells_without_model(library):
    """A latch has no model, nor has a function of other names."""
    cell = type(library.nand2)("L", 1.0, {"D": (0, 0)}, {"Q": "IQ"}, {"other": "latch"}, (), False,
                               (), 0.0)  # fmt: skip
    with pytest.raises(ValueError, match="L: no model"):
        cell_model(cell)
