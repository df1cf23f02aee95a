"""Verilog that commands write is legal for slang, yosys, Icarus and Verilator; netlists of cells
have the ports of the RTL."""

import re
from pathlib import Path

import pytest
from pyslang.parsing import TokenKind

from splatcore.app.cli.synth import PARTS
from splatcore.eda.cells.cell_netlist import CellNetlist, put_together
from splatcore.eda.cells.mapping import Mapped, mapped
from splatcore.eda.cells.opensta import verilog
from splatcore.eda.deliver.names import KEYWORDS
from splatcore.eda.deliver.verilog import NAMES, stage_source, write_stages, write_top
from splatcore.eda.gates.synth import Netlist
from splatcore.hdl.stages import LARGE, STAGES
from splatcore.spec.config import PRESETS, TINY
from tb.helpers.front_ends import (
    ALL,
    errors,
    icarus,
    ports,
    read_slang,
    slang,
    verilator,
    write_boxes,
)
from tb.helpers.runs import marked

FAULTS = {
    "a keyword": "module top (input a, output begin); assign begin = a; endmodule",
    "a name used twice": "module top (input a, output b); inner b (a, b); endmodule",
    "a missing module": "module top (input a); other other (a); endmodule",
}

INNER = "\nmodule inner (input i, output o); assign o = i; endmodule\n"


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("front_end", ALL, ids=lambda each: each.__name__)
def test_faults_are_found(front_end, fault, tmp_path):
    path = tmp_path / "top.v"
    path.write_text(FAULTS[fault] + INNER)
    assert front_end("top", path)
    path.write_text(
        "module top (input a, output \\begin ); inner b (a, \\begin ); endmodule" + INNER
    )
    assert not front_end("top", path)


def test_keywords_are_slang_s():
    found = {name.removesuffix("Keyword") for name in dir(TokenKind) if name.endswith("Keyword")}
    assert {name.lower() for name in found} == {name.replace("_", "") for name in KEYWORDS}


@pytest.mark.slow
def test_stages(tiny_stages):
    for name in STAGES:
        assert not errors(f"splatcore_{name}", tiny_stages / f"splatcore_{name}.v", by=[slang])


@pytest.mark.slow
def test_the_machine(tiny_rtl):
    """The machine with its testbench."""
    files = [tiny_rtl / name for name in ("splatcore_testbench.v", *NAMES.sources)]
    assert not errors("splatcore_testbench", *files)


@pytest.mark.verify
@pytest.mark.parametrize("name", PRESETS)
def test_every_machine(name, tmp_path):
    """Stages and the machine; its testbench, too, except in yosys, as it cannot be synthesised."""
    config = PRESETS[name]
    write_stages(config, tmp_path)
    for stage in STAGES:
        assert not errors(f"splatcore_{stage}", tmp_path / f"splatcore_{stage}.v", by=ALL)
    write_top(config, tmp_path)
    sources = [tmp_path / file for file in NAMES.sources]
    assert not errors(NAMES.top, *sources, by=[read_slang])
    bench = tmp_path / "splatcore_testbench.v"
    assert not errors("splatcore_testbench", bench, *sources, by=[slang, icarus, verilator])


def written(netlist: CellNetlist, name: str, folder: Path) -> list[Path]:
    """A netlist's file, and one with its cells and memories."""
    path = folder / f"{name}.v"
    path.write_text(verilog(netlist, name))
    return [path, write_boxes(path, netlist.library)]


PART = ("merge", "frame")  # parts with ports `begin` that are mapped fast


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", marked((name for name in PARTS if name not in LARGE), {*PARTS} - {*PART})
)
def test_netlists(name, library, tmp_path):
    """Netlists of parts are legal and have the ports of the parts' Verilog."""
    component = PARTS[name](TINY)
    netlist = put_together(library, {"": mapped(Netlist.of(component), library)})
    paths = written(netlist, name, tmp_path)
    assert not errors(name, *paths, by=[slang, icarus] if name in PART else ALL)
    rtl = tmp_path / "rtl.v"
    rtl.write_text(stage_source(name, PARTS[name](TINY), TINY))
    assert ports(name, *paths) == ports(f"splatcore_{name}", rtl)


def test_names_in_netlists(library, tmp_path):
    """Ports named like keywords, wires and cells; registers named like ports or without a name; an
    output before the input that it equals, a constant output."""
    cell = library.flip_flop
    pins = (*cell.inputs, *cell.functions)

    def flip_flop(name: str, data: int, output: int) -> tuple[str, str, list]:
        nets = {cell.clock: 2, cell.data: data} | {pin: output for pin in cell.functions}
        return cell.name, name, [nets[pin] for pin in pins]

    cells = [flip_flop("a", 4, 5), flip_flop("b", 5, 6), flip_flop("c", 6, 7)]
    outputs = [("same", [4, 3]), ("small", [5]), ("n6", [7]), ("u1", ["1", "x"])]
    inputs = [("clk", [2]), ("begin", [3]), ("release", [4])]
    all_ports = [(name, "output", bits) for name, bits in outputs]
    all_ports += [(name, "input", bits) for name, bits in inputs]
    piece = Mapped(cells, [], all_ports, {"5": "small", "7": "n6"})
    paths = written(put_together(library, {"": piece}), "top", tmp_path)
    assert not errors("top", *paths, by=ALL)
    found = ports("top", *paths)
    assert found == {name: ("Out", len(bits)) for name, bits in outputs} | {
        name: ("In", 1) for name, _ in inputs
    }
    text = paths[0].read_text()
    assert "small_reg (" in text and "n6_reg (" in text
    assert re.search(r"assign same\[0\] = \\release ;", text)
    assert "assign u1[0] = 1'b1;" in text and not re.search(r"assign \\(begin|release) ", text)
