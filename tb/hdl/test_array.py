"""Arrays under stalls: a few items of the garden through every program, both simulators."""

import shutil

import numpy as np
import pytest

from splatcore.golden.points import project_points
from splatcore.golden.program import Values
from splatcore.hdl.points.array import Array
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.spec.config import DEFAULT
from splatcore.spec.microprogram import Program, program, projection
from splatcore.spec.number import Bits
from splatcore.spec.record import Record

ITEMS = 60

PROGRAMS = {
    "cull": (program("cull"), "culled"),
    "place": (program("place"), "placed"),
    "project_sh": (projection(DEFAULT), "projected"),
}


def packed(names: tuple[str, ...], values: Values, count: int) -> np.ndarray:
    """Rows of codes, as the ports of an array carry them."""
    format = DEFAULT.arithmetic
    record = Record("row", {name: Bits(format.width) for name in names})
    codes = {}
    for name in names:
        code = format.encode(values[name])
        codes[name] = code[:count] if code.ndim else np.broadcast_to(code, count)
    return record.pack(codes)


def run(steps: Program, values: Values, folder, simulator: str):
    np.save(folder / "fields.npy", packed(steps.fields, values, ITEMS))
    np.save(folder / "outputs.npy", packed(steps.outputs, values, ITEMS))
    np.save(folder / "constants.npy", packed(steps.constants, values, 1))
    array = Array(DEFAULT, steps)
    run_testbench(
        array, "tb.testbenches.array", simulator=simulator, folder=str(folder),
        interval=array.plan.interval,
    )  # fmt: skip


@pytest.fixture(scope="module")
def garden():
    model, _ = pack(generate("garden", 2000))
    return project_points(DEFAULT, model, generated_camera("garden"))


@pytest.mark.slow
@pytest.mark.parametrize("name", PROGRAMS)
def test_under_stalls(garden, tmp_path, name):
    steps, part = PROGRAMS[name]
    values = garden.frame.constants | getattr(garden, part)
    run(steps, values, tmp_path, "verilator")


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("iverilog"), reason="needs Icarus: apt-get install iverilog")
@pytest.mark.parametrize("name", ["cull", "place"])
def test_under_icarus(garden, tmp_path, name):
    steps, part = PROGRAMS[name]
    run(steps, garden.frame.constants | getattr(garden, part), tmp_path, "icarus")


@pytest.mark.slow
def test_a_wrong_bit_is_named(garden, tmp_path):
    steps, part = PROGRAMS["cull"]
    values = garden.frame.constants | getattr(garden, part)
    depth = values["z"].copy()
    depth[ITEMS // 2] *= 1 + 2.0**-16
    with pytest.raises(AssertionError, match="every_output_is_right"):
        run(steps, values | {"z": depth}, tmp_path, "verilator")
