"""Area and timing of components in a small library, against yosys and OpenSTA; the machine."""

import re
import shutil
import subprocess
from collections import Counter

import numpy as np
import pytest

from splatcore.eda import paper
from splatcore.eda.cells import ways as module
from splatcore.eda.cells.cell_netlist import put_together
from splatcore.eda.cells.delays import fo4
from splatcore.eda.cells.liberty_file import read_liberty
from splatcore.eda.cells.mapping import EFFORTS, MAP, SUMS, mapped, recipe
from splatcore.eda.cells.opensta import verilog, write_opensta
from splatcore.eda.cells.silicon import Silicon, area_28nm, long_paths, machine_silicon, silicon
from splatcore.eda.cells.ways import fastest
from splatcore.eda.cells.wire_load import with_wire_loads
from splatcore.eda.gates import machine_gates
from splatcore.eda.gates.macros import memory_size
from splatcore.eda.gates.synth import Netlist
from splatcore.hdl.arithmetic.add import Add
from splatcore.hdl.arithmetic.multiply import Multiply
from splatcore.hdl.sorting.sorter import Sorter
from splatcore.spec.config import DEFAULT, TINY
from tb.helpers.command import check_documented, load, run
from tb.helpers.front_ends import errors, icarus, slang, verilator, write_boxes
from tb.helpers.liberty import AREA_FF, DATA, GATES, liberty_files, needs_libraries

SMALL_FO4_MAX, WHOLE_FO4_MAX = 70, 45.1
"""Limits in FO4 of the longest path: of `TINY` in the small library (measured: 68.6), and of
`DEFAULT` in a user's library (measured: 45.0 in SG13G2), enough for 800 MHz. Never raise them."""


@pytest.mark.slow
def test_areas_equal_yosys_s(library):
    """Area of an adder and of its flip-flops equals yosys's count."""
    netlist = Netlist.of(Add(TINY.arithmetic, TINY.add_latency))
    found = silicon(Add(TINY.arithmetic, TINY.add_latency), library)
    area = found.facts["um2"]
    files = {"cells.lib": with_wire_loads(library), "constraints": constraints_of(library)}
    count = netlist.run(
        MAP.format(left_out="", sums="") + "tee -o area.txt stat -liberty cells.lib\n",
        lambda files: float(re.search(r"Chip area.*: ([\d.]+)", files["area.txt"])[1]),
        files | {"recipe": recipe(*EFFORTS[0])},
    )
    assert area == pytest.approx(count)
    facts = found.facts
    assert facts["flip_flops_um2"] == AREA_FF * facts["flip_flops"] > 0
    assert facts["flip_flops"] == netlist.gates()["flip_flops"]
    assert facts["nand2"] == pytest.approx(area / GATES["NAND2"][2])
    longest = facts["longest"]
    assert longest["ps"] / longest["fo4"] == pytest.approx(1000 * fo4(library))
    assert facts["longest_with_wires"]["ps"] > longest["ps"]


def constraints_of(library) -> str:
    return f"set_driving_cell {library.driver.name}\nset_load {1000 * DATA:.3f} [all_outputs]\n"


@pytest.mark.slow
def test_few_gates_are_buffers(library):
    """Fan-out stays at 16 or less with under 10 % buffers."""
    found = silicon(Sorter(TINY), library)
    assert found.netlist.is_buffer.mean() < 0.1
    loads = found.timing.fanout[2:]
    clock = next(port.nets[0] for port in found.netlist.ports if port.name == "clk")
    assert np.delete(loads, clock - 2).max() <= 16


@pytest.mark.slow
@pytest.mark.parametrize("most", [0, 1000])
def test_choice_of_adders(library, monkeypatch, most):
    """The smallest fast-enough adder is chosen; if none is, the fastest of more ways."""
    netlist = Netlist.of(Multiply(TINY.arithmetic, TINY.multiply_latency))
    monkeypatch.setattr(module, "ALONE", (1000, most or 1))

    def measured(piece) -> tuple[float, float]:
        alone = Silicon.of(put_together(library, {"": piece}))
        return alone.wired.longest.time, alone.netlist.area

    found = {
        (sums, effort): measured(mapped(netlist, library, sums, effort))
        for sums in SUMS
        for effort in EFFORTS
    }
    times, areas = zip(*(found[sums, EFFORTS[0]] for sums in SUMS), strict=True)
    assert len(set(times)) == len(set(areas)) == len(SUMS)
    assert len(set(found.values())) == len(found)
    made = []
    monkeypatch.setattr(module, "mapped", lambda *args: made.append(args[-1]) or mapped(*args))
    time, area = measured(fastest(netlist, library))
    assert set(made) == set(EFFORTS[:1] if most else EFFORTS)
    assert area == min(areas) if most else time == min(time for time, _ in found.values())


needs_opensta = pytest.mark.skipif(
    not shutil.which("sta"), reason="needs OpenSTA: apt-get install opensta"
)


def opensta(folder, name) -> tuple[float, float]:
    """Run OpenSTA; return arrival and slack of the slowest path in ns."""
    done = subprocess.run(
        ["sta", "-no_splash", "-exit", f"{name}.tcl"],
        cwd=folder, capture_output=True, text=True, check=True
    )  # fmt: skip
    assert not re.search("error|warning", done.stdout + done.stderr, re.I), done.stdout
    arrival = re.search(r"(-?[\d.]+) +data arrival time", done.stdout)
    slack = re.search(r"(-?[\d.]+) +slack", done.stdout)
    return float(arrival[1]), float(slack[1])


STOPS = {
    "sorter.v": ("endmodule", ""),
    "sorter.tcl": ("link_design sorter", "link_design another"),
    "sorter_memories.lib": ("library", "library {"),
    "sorter.sdc": ("-period", "-times"),
    "cells.lib": ("cell (", "cell (another_"),
}
"""A change of each file of OpenSTA that is an error: old and new text."""


@needs_opensta
@pytest.mark.slow
def test_scripts_stop_after_an_error(liberty_path, library, tmp_path):
    """OpenSTA alone would go on and end with status 0."""
    path = tmp_path / "cells.lib"
    path.write_text(liberty_path.read_text())
    write_opensta(silicon(Sorter(TINY), library).timing, path, "sorter", tmp_path)
    opensta(tmp_path, "sorter")
    for name, (old, new) in STOPS.items():
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text.replace(old, new))
        done = subprocess.run(
            ["sta", "-no_splash", "-exit", "sorter.tcl"],
            cwd=tmp_path, capture_output=True, text=True
        )  # fmt: skip
        (tmp_path / name).write_text(text)
        printed = done.stdout + done.stderr
        assert done.returncode, (name, printed)
        assert "Error" in printed and "sorter.tcl stopped at" in printed, (name, printed)
        assert "slack" not in printed, (name, printed)


LIBRARIES = [pytest.param(None, id="small")] + [
    pytest.param(file, id=file.name, marks=pytest.mark.verify) for file in liberty_files()
]


@needs_opensta
@pytest.mark.slow
@pytest.mark.parametrize("file", LIBRARIES)
def test_opensta_finds_the_same(liberty_path, tmp_path, file):
    """OpenSTA's slack is 0 with our longest path as the clock period: for a sorter, whose path
    begins at a memory, and for an adder."""
    file = file or liberty_path
    library = read_liberty(file)
    if file.suffix == ".gz":
        file = tmp_path / file.stem
        file.write_text(library.text)
    parts = {"sorter": Sorter(TINY), "adder": Add(TINY.arithmetic, TINY.add_latency)}
    for name, component in parts.items():
        timing = silicon(component, library).timing
        write_opensta(timing, file, name, tmp_path)
        arrival, slack = opensta(tmp_path, name)
        assert abs(slack) < 2e-4
        assert timing.longest.time / 2 < arrival <= timing.longest.time


def test_square_millimetres():
    """With the paper's area per gate and per kilobyte its machine has the area it states."""
    found = area_28nm(sum(paper.GATES.values()), sum(paper.MEMORIES.values()))
    assert sum(found.values()) == pytest.approx(paper.AREA_ALL / 1e6, rel=1e-5)
    assert found["logic_mm2"] == pytest.approx(sum(paper.AREA.values()) / 1e6)


@pytest.mark.slow
def test_command(liberty_path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = "--stage", "add", "--stage", "codebook", "--preset", "tiny", "--json", "s.json"
    assert run("synth", *words, "--liberty", liberty_path, "-o", "out") == 0
    printed = capsys.readouterr().out
    facts = load(tmp_path / "s.json")
    assert list(facts["stages"]) == ["add", "codebook"] and "ASSUMED" in printed
    assert facts["liberty"]["fo4_ps"] == pytest.approx(1000 * fo4(read_liberty(liberty_path)))
    check_documented("`splatcore synth --liberty`", [*facts["liberty"], *facts["stages"]["add"]])
    longest = facts["stages"]["add"]["longest"]
    check_documented("`splatcore synth --liberty`", [*longest, *longest["cells"][0]])
    assert longest["to"]["name"] in printed and f"{longest['ps']:,.0f}" in printed
    for name in ("add.v", "add.tcl", "add.sdc", "codebook_memories.lib"):
        assert (tmp_path / "out" / name).exists()
    for name in facts["stages"]:
        path = tmp_path / "out" / f"{name}.v"
        assert not errors(name, path, write_boxes(path, read_liberty(liberty_path)))


@pytest.mark.verify
def test_the_whole_machine(library, tmp_path):
    """Parts sum to the whole machine; its longest path crosses parts and is within the limit. Its
    netlist is legal Verilog."""
    hierarchy = machine_gates.netlist(TINY)
    parts, whole = machine_silicon(hierarchy, library, lambda *_: None)
    assert whole.netlist.area == pytest.approx(sum(each.um2 for each in parts))
    assert whole.facts["flip_flops"] == sum(each.flip_flops for each in parts)
    held = Counter(memory_size(module) for _, module, _ in whole.netlist.memories)
    assert held == Counter(machine_gates.whole(hierarchy).memories)
    across = [row for row in long_paths(whole.timing, 20) if row["from_part"] != row["to_part"]]
    assert across

    assert 30 < whole.facts["longest"]["fo4"] < SMALL_FO4_MAX

    path = tmp_path / "top.v"
    path.write_text(verilog(whole.netlist, "top"))
    assert not errors("top", path, write_boxes(path, library), by=[slang, icarus, verilator])


@needs_libraries
@pytest.mark.verify
def test_depth_of_the_whole_machine(tmp_path):
    """The machine at full size, in the first installed library; its netlist is legal Verilog."""
    library = read_liberty(liberty_files()[0])
    _, whole = machine_silicon(machine_gates.netlist(DEFAULT), library, lambda *_: None)
    assert whole.facts["longest"]["fo4"] < WHOLE_FO4_MAX

    path = tmp_path / "top.v"
    path.write_text(verilog(whole.netlist, "top"))
    assert not errors("top", path, write_boxes(path, library), by=[slang])
