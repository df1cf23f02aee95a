"""The command `example`: its folder renders a frame on a machine without Splatcore."""

import os
import re
import subprocess
import sysconfig
import venv
from pathlib import Path

import numpy as np
import pytest

from splatcore.eda.example.example import LIBRARIES
from splatcore.sim.frame.picture import read_png
from tb.helpers.command import run
from tb.helpers.front_ends import slang
from tb.helpers.runs import needs_icarus

SIMULATORS = ["verilator", pytest.param("icarus", marks=needs_icarus)]


@pytest.fixture(scope="module")
def example(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("example") / "frame"
    assert run("example", "-o", folder) == 0
    return folder


@pytest.fixture(scope="module")
def python(tmp_path_factory) -> Path:
    """Python of a new environment with the libraries of this one, but without Splatcore."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True)
    site = next(folder.glob("lib/python*/site-packages"))
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib"))
    return folder / "bin" / "python"


def make(folder: Path, python: Path, *words: str) -> subprocess.CompletedProcess:
    """Run make in a folder, without this environment on PATH or in variables."""
    plain = os.environ.items() - {("PATH", os.environ["PATH"])}
    inside = sysconfig.get_path("scripts")
    variables = {
        k: v for k, v in plain if not k.startswith(("MAKE", "PYTHON", "VIRTUAL", "VERILATOR"))
    }
    path = [place for place in os.environ["PATH"].split(os.pathsep) if place != inside]
    return subprocess.run(
        ["make", f"PYTHON={python}", *words],
        cwd=folder, env=variables | {"PATH": os.pathsep.join(path)}, capture_output=True, text=True,
    )  # fmt: skip


def check_alone(folder: Path, python: Path):
    """Check that Splatcore cannot be imported and that no file of the folder imports it."""
    done = subprocess.run(
        [python, "-c", "import cocotb, splatcore"], cwd=folder, capture_output=True, text=True
    )
    assert "No module named 'splatcore'" in done.stderr
    for path in folder.glob("*.py"):
        assert not re.search(r"^\s*(from|import) (?:splatcore|tb)\b", path.read_text(), re.M)


@pytest.mark.verify
@pytest.mark.parametrize("simulator", SIMULATORS)
def test_frame(example, python, simulator):
    check_alone(example, python)
    (example / "frame.png").unlink(missing_ok=True)
    done = make(example, python, f"SIM={simulator}")
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    pixels = read_png(example / "frame.png")
    assert np.array_equal(pixels, read_png(example / "expected.png"))
    assert pixels.shape == (32, 32, 3) and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 300


@needs_icarus
@pytest.mark.slow
def test_a_wrong_picture_is_found(example, python):
    """The bench fails when the machine renders another background than expected."""
    path = example / "frame.json"
    text = path.read_text()
    fault = text.replace('"BACKGROUND_RED": 0', '"BACKGROUND_RED": 300')
    assert fault != text
    path.write_text(fault)
    try:
        done = make(example, python, "SIM=icarus")
    finally:
        path.write_text(text)
    assert done.returncode != 0 and "frame.png is not expected.png" in done.stdout


@pytest.mark.slow
def test_verilog(example):
    """Its Verilog is legal, with the testbench as the top module."""
    assert not slang("splatcore_testbench", *(example / "rtl").glob("*.v"))


def test_requirements_list_the_libraries(example):
    lines = (example / "requirements.txt").read_text().split()
    assert [line.partition("==")[0] for line in lines] == list(LIBRARIES)


@pytest.mark.verify
def test_requirements_are_sufficient(example, tmp_path):
    """The example runs with nothing but its requirements, installed from the package registry."""
    venv.create(tmp_path, with_pip=True, symlinks=True)
    python = tmp_path / "bin" / "python"
    done = make(example, python, "install")
    assert done.returncode == 0, done.stderr
    check_alone(example, python)
    done = make(example, python)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
