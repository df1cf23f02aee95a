"""Delivered Verilog in other tools: readable names, two machines in one design, FuseSoC."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from splatcore.eda.deliver.names import readable, without_source
from splatcore.eda.deliver.verilog import Names, lint, stage_source, write_top
from splatcore.hdl.points.place import Place
from splatcore.spec.config import TINY
from tb.helpers.command import ROOT, check_refused
from tb.helpers.runs import needs_icarus

HERE = Path(__file__).parent

NETS = re.compile(r"^  (?:wire|reg) (?:\[\S+\] )?(\S+)", re.M)

WIDE = replace(TINY, name="WIDE", port=256)


def test_each_kind_of_name():
    """Names from a source line, a slice, a register's next value; keywords and used names."""
    generated, named = ((HERE / name).read_text() for name in ("generated.v", "readable.v"))
    assert readable(generated) == named
    assert "(*" not in without_source(named) and without_source(named).count("\n") == 17


def test_names_of_a_stage():
    """Names are plain and unique; most contain the Python line that made the net."""
    text = stage_source("place", Place(TINY), TINY, names=Names("mine"))
    assert "\\" not in text and "splatcore_" not in text and "module mine_place(" in text
    for module in text.split("\nendmodule"):
        nets = [name.rstrip(";") for name in NETS.findall(module)]
        assert len(set(nets)) == len(nets)
    nets = NETS.findall(text)
    assert len([name for name in nets if name.startswith("net_")]) < len(nets) / 5
    files = set(re.findall(r'src = "([^":|]+)', text))
    assert "hdl/points/array.py" in files
    assert all((ROOT / file).is_file() for file in files if not file.startswith("amaranth/"))
    bare = stage_source("place", Place(TINY), TINY, names=Names("mine", source_lines=False))
    assert "src =" not in bare and NETS.findall(bare) == nets and len(bare) < 0.9 * len(text)


@pytest.mark.verify
def test_two_machines_in_one_design(tmp_path):
    """Two machines with different prefixes and port widths share no module name; lint passes."""
    sources = []
    for config, names in ((TINY, Names("left")), (WIDE, Names("right", source_lines=False))):
        folder = tmp_path / names.prefix
        write_top(config, folder, names)
        sources += [folder / name for name in names.sources]
    lines = lint("pair", HERE / "pair.v", *sources)
    assert all("PINMISSING" in line for line in lines if line.startswith("%Warning")), lines
    assert all("warning(s)" in line for line in lines if line.startswith("%Error")), lines
    modules = re.findall(r"^module (\w+)", "".join(path.read_text() for path in sources), re.M)
    assert len(set(modules)) == len(modules)


def test_prefixes_must_be_identifiers(capsys):
    for name in ("2x", "a-b", "é", ""):
        check_refused(capsys, f"verilog -o none --prefix={name}", "is not a Verilog identifier")


@pytest.fixture
def delivered(tiny_rtl, tmp_path) -> Path:
    """A folder with a copy of TINY's files in `rtl/`."""
    shutil.copytree(tiny_rtl, tmp_path / "rtl")
    return tmp_path


def at_prompt(folder: Path, script: str) -> subprocess.CompletedProcess:
    """Run a script in a folder, with FuseSoC on the path."""
    variables = {k: v for k, v in os.environ.items() if k != "VERILATOR_ROOT"}
    variables["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), variables["PATH"]])
    return subprocess.run(
        ["bash", "-ec", script], cwd=folder, env=variables, capture_output=True, text=True
    )


def flow(folder: Path, target: str) -> subprocess.CompletedProcess:
    """Run the commands of docs/integration.md for a FuseSoC target."""
    text = (ROOT / "docs" / "integration.md").read_text()
    (block,) = re.findall(r"^```sh\n(root=.*?)^```", text, re.M | re.S)
    return at_prompt(folder, block.replace("lint", target))


@pytest.mark.verify
def test_fusesoc_lint(delivered):
    done = flow(delivered, "lint")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "-Wall" in "".join(path.read_text() for path in delivered.rglob("*.vc"))


@needs_icarus
@pytest.mark.slow
@pytest.mark.parametrize("fault", [False, True])
def test_fusesoc_sim(delivered, fault):
    """The testbench passes in Icarus, and fails if it expects another ID."""
    if fault:
        bench = delivered / "rtl" / "splatcore_testbench.v"
        text = bench.read_text()
        bench.write_text(text.replace("32'h544c5053", "32'h544c5054"))
        assert bench.read_text() != text
    done = flow(delivered, "sim")
    assert (done.returncode == 0) == (not fault), done.stdout + done.stderr
    assert ("splatcore_testbench: passed" in done.stdout + done.stderr) == (not fault)


@pytest.mark.slow
@pytest.mark.parametrize("target", ["default --tool icarus", "synth"])
def test_fusesoc_targets(delivered, target):
    """All files that the core file names exist, for every target."""
    words = f"fusesoc --cores-root rtl run --setup --target {target} splatcore"
    done = at_prompt(delivered, words)
    assert done.returncode == 0, done.stdout + done.stderr
