"""Generated Verilog: headers, names, memories, lint, netlist checks; synthesis by parts."""

import csv
import re
from collections import Counter
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from splatcore.eda.deliver.verilog import NAMES, WAIVERS, lint, stage_source, write_top
from splatcore.eda.gates import machine_gates
from splatcore.eda.gates.machine_gates import PARTS, Size, faults, synthesise_machine
from splatcore.eda.gates.macros import Macros, module
from splatcore.eda.gates.synth import DEPTH_MAX, SPEED, Netlist, memories
from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.points.place import Place
from splatcore.hdl.stages import CONTROL, LARGE, PRIMITIVES, STAGES, WHOLE
from splatcore.sim.rtl.convert import converted
from splatcore.sim.rtl.streams import Simulation, StreamRuleError
from splatcore.spec import config
from splatcore.spec.config import DEFAULT, MEMORY_MAX, PAPER, TINY
from splatcore.spec.quads import QUADS
from tb.helpers.command import run
from tb.helpers.runs import marked

HERE = Path(__file__).parent

DEEP = ("sub_sorter", "merge", "prepare", "setup", "mark", "evaluate", "lane")
"""Parts of the stages that take too long to synthesise whole."""


@pytest.fixture(scope="module")
def netlist():
    """Netlist of a part of `DEFAULT` by name, elaborated once."""
    return cache(lambda name: Netlist.of((STAGES | PRIMITIVES | CONTROL)[name](DEFAULT)))


SIZES = {n: getattr(TINY, n) for n in config.SIZES if n != "sh_degree"}  # of TINY


@pytest.mark.verify
def test_stages_are_clean(tiny_stages):
    """Each stage's file, as the command writes it, passes lint."""
    for name in STAGES:
        path = tiny_stages / f"splatcore_{name}.v"
        text = path.read_text()
        assert text.startswith(f"// Splatcore {name}, preset TINY")
        assert f"module splatcore_{name}(" in text
        assert lint(path.stem, path) == []
    assert (tiny_stages / WAIVERS.name).read_bytes() == WAIVERS.read_bytes()
    assert len(list(tiny_stages.iterdir())) == len(STAGES) + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "machine",
    [pytest.param(c, marks=pytest.mark.verify) for c in (replace(PAPER, **SIZES), DEFAULT, PAPER)],
    ids=["PAPER, small", "DEFAULT", "PAPER"],
)
def test_blocks_are_clean(machine, tmp_path):
    """Every block passes lint; the blocks contain all stages."""
    for name in (block for block in WHOLE if block != "control"):
        path = tmp_path / f"splatcore_{name}.v"
        path.write_text(stage_source(name, STAGES[name](machine), machine))
        assert lint(path.stem, path) == []


def test_lint_finds_faults():
    found = "\n".join(lint("faulty", HERE / "faulty.v"))
    assert "LATCH" in found and "UNDRIVEN" in found


@pytest.mark.slow
def test_faults_are_found():
    found = "\n".join(faults("unsound", HERE / "unsound.v"))
    for fault in ("latch ", "logic loop", "conflicting drivers", "nothing is used but has no"):
        assert fault in found
    assert len(found.splitlines()) == 4


def test_every_waiver_has_a_reason():
    lines = WAIVERS.read_text().splitlines()
    for before, line in pairwise(lines):
        if line.startswith("lint_off"):
            assert before.startswith(("// ", "lint_off"))


def test_source_has_a_header():
    text = stage_source("place", Place(DEFAULT), DEFAULT)
    assert "preset DEFAULT" in text and "hdl/points/place.py" in text and "Timing" in text
    assert "module splatcore_place(" in text and "module splatcore_place_array_pe1 (" in text
    names = re.findall(r"^module ([^\s(]+)", text, re.M)
    assert len(set(names)) == len(names) > 10
    assert all(re.fullmatch(r"splatcore_place\w*", name) for name in names)
    assert "[-1:0]" not in text


@pytest.mark.slow
def test_the_machine_is_clean(tiny_rtl):
    """The whole machine: lint, latches, loops, drivers, names, list of memories, constraints."""
    names = {path.name for path in tiny_rtl.iterdir()}
    assert {"splatcore.core", "splatcore.sdc", "memories.csv", WAIVERS.name} < names
    sources = [tiny_rtl / name for name in NAMES.sources]
    assert lint(NAMES.top, *sources) == []
    assert faults(NAMES.top, *sources) == []
    text = "".join(path.read_text() for path in sources)
    modules = re.findall(r"^module (\w+)", text, re.M)
    assert len(set(modules)) == len(modules) and all(m.startswith("splatcore_") for m in modules)
    rows = list(csv.DictReader((tiny_rtl / "memories.csv").open()))
    listed = Counter({(int(row["words"]), int(row["bits"])): int(row["count"]) for row in rows})
    assert all(int(row["count"]) == len(row["instances"].split()) for row in rows)
    expected = [size for parts in WHOLE.values() for make in parts for size in memories(make(TINY))]
    assert listed == Counter(expected)
    for row in rows:
        assert f"module {row['module']} (" in text
        assert len(re.findall(rf"^  {row['module']} ", text, re.M)) == int(row["count"])
    ports = re.findall(r"^  (?:in|out)put (?:\[\S+\] )?(\w+);", text, re.M)
    constraints = (tiny_rtl / "splatcore.sdc").read_text()
    assert "period 1.25 " in constraints and set(re.findall(r"\w_axi__\w+", constraints)) < {*ports}


@pytest.mark.verify
def test_the_machine_with_wide_addresses_is_clean(tmp_path):
    """Lint and 64-bit address ports of the machine written for a preset file."""
    (tmp_path / "wide.toml").write_text('base = "TINY"\naddress_bits = 64\n')
    assert run("verilog", "--preset", tmp_path / "wide.toml", "-o", tmp_path) == 0
    sources = [tmp_path / name for name in NAMES.sources]
    assert lint(NAMES.top, *sources) == []
    ports = re.findall(r"^  output \[63:0\] (m_axi__a[rw]addr);", sources[-1].read_text(), re.M)
    assert sorted(ports) == ["m_axi__araddr", "m_axi__awaddr"]
    bench = (tmp_path / "splatcore_testbench.v").read_text()
    assert all(f'"{name}_HIGH"' in bench for name in ("MODEL", "SCRATCH", "PIXELS"))


@pytest.mark.verify
@pytest.mark.parametrize("config", [DEFAULT, PAPER], ids=lambda config: config.name)
def test_machines_of_full_size_are_clean(config, tmp_path):
    write_top(config, tmp_path)
    assert lint(NAMES.top, *(tmp_path / name for name in NAMES.sources)) == []


@pytest.mark.verify
@pytest.mark.parametrize(
    "lanes, part, count", [("block", "blend", TINY.rasterizers), ("quads", "quad", QUADS)]
)
def test_parts_add_up_to_the_whole(lanes, part, count):
    """Each flip-flop is in exactly one part; equal parts share one netlist."""
    hierarchy = machine_gates.netlist(replace(TINY, lanes=lanes))
    about = machine_gates.examined(machine_gates.whole(hierarchy))
    assert about["faults"] == []
    work = machine_gates.pieces(hierarchy)
    other = ({"blend", "quad"} - {part}).pop()
    assert {piece.part.name for piece in work} == {each.name for each in PARTS} - {other}
    found = {each.part.name: machine_gates.flip_flops_before(each.netlist) for each in work}
    times = Counter(piece.part.name for piece in work)
    assert times["evaluate"] == TINY.rasterizers and times["chunk"] == 1 and times[part] == count
    counted = sum(count * times[name] for name, count in found.items())
    assert counted == about["flip_flops_before"] > 20_000
    texts = Counter(name for name, _ in {(each.part.name, each.netlist.text) for each in work})
    assert texts[part] == texts["sub_sorter"] == 1
    held = [memory for piece in work for memory in piece.netlist.memories]
    assert Counter(held) == Counter(machine_gates.whole(hierarchy).memories)


def test_table_of_the_machine(monkeypatch, capsys):
    """The table sums gates by stage and in all, next to the paper's; faults are reported."""
    found = [
        Size(part, 2, 3000.0, 20, 3200.0, 10 + k, 100, 5, 110, ("splatcore_memory_4x25",))
        for k, part in enumerate(PARTS)
    ]
    about = {"flip_flops_before": 110 * len(PARTS), "faults": ["latch there"]}
    for name, value in (("netlist", None), ("whole", None), ("sizes", found), ("examined", about)):
        monkeypatch.setattr(machine_gates, name, lambda *_, value=value: value)
    facts = synthesise_machine(DEFAULT)
    printed = capsys.readouterr()
    assert re.search(r"stage 0 +6\.0 +6\.4 +11 +12\.9", printed.out)
    assert re.search(r"sub_sorter +2 +1\.5 +3\.0 +3\.2 +19", printed.out)
    assert re.search(rf"all +{3 * len(PARTS)}\.0 .* 1,143\.8", printed.out)
    assert "none: 1" in printed.out.replace("\n", " ") and "latch there" in printed.err
    assert facts["nand2"] == 3000 * len(PARTS) and facts["faults"] == ["latch there"]
    assert facts["flip_flops_before"]["parts"] == facts["flip_flops_before"]["whole"]


@pytest.mark.slow
@pytest.mark.parametrize("fault", [None, "read_enable"])
def test_memory_modules_act_as_amaranth_s(fault):
    """A queue works with the memory module; without the read enable its payload changes."""
    macros, queue = Macros(), Queue(24, 12, memory=True)
    text = converted(queue, platform=macros)
    (size,) = macros.sizes
    assert size == (12, 24)
    text += module(*size).replace(f"if ({fault}) ", "")
    rows = np.random.default_rng(0).integers(0, 256, (500, 3), np.uint8)

    simulation = Simulation(queue, source=text)
    if fault:
        with pytest.raises(StreamRuleError):
            simulation.run({"i": rows}, stall=0.5, seed=1)
    else:
        result = simulation.run({"i": rows}, expected={"o": len(rows)}, stall=0.5, seed=1)
        assert np.array_equal(result.outputs["o"], rows)


FLAT = [name for name in STAGES if name not in LARGE]  # stages that are synthesised whole

SLOW = (
    "points", "project", "setup", "sub_sorter", "merge", "mark", "bin", "prepare", "place"
)  # fmt: skip
"""Parts that take long to synthesise."""


@pytest.mark.slow
@pytest.mark.parametrize("name", marked([*FLAT, *DEEP, *CONTROL], SLOW))
def test_no_path_is_too_deep(name, netlist):
    """No part is deeper than DEPTH_MAX; `points` contains all stages that work on points."""
    assert netlist(name).mapped(SPEED)["depth"] <= DEPTH_MAX


@pytest.mark.slow
@pytest.mark.parametrize("name", marked([*FLAT, *DEEP], SLOW))
def test_speed_costs_few_gates(name, netlist):
    """Synthesis for speed takes at most 10 % more gates, 15 % in the large parts."""
    found = netlist(name).gates()
    least, most = (0.95, 1.15) if name in DEEP else (1, 1.1)
    assert least * found["nand2"] < found["speed_nand2"] < most * found["nand2"]


@pytest.mark.slow
def test_memories_fit():
    """Memories of all parts of DEFAULT stay within its bound."""
    sizes = [size for parts in WHOLE.values() for make in parts for size in memories(make(DEFAULT))]
    assert 0 < sum(words * bits for words, bits in sizes) / 8 <= MEMORY_MAX
