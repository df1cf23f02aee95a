"""The stages of the point half under cocotb and Icarus, an independent simulator."""

import shutil

import numpy as np
import pytest

from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.spec.config import DEFAULT
from tb.helpers.point_rows import point_rows
from tb.helpers.stage_cases import case, settled_outputs

GAUSSIANS = {"chunk": 600, "cull": 60, "place": 60, "project": 24}
"""Icarus is slow."""


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("iverilog"), reason="needs Icarus: apt-get install iverilog")
@pytest.mark.parametrize("stage", GAUSSIANS)
def test_under_icarus(stage, tmp_path):
    model, _ = pack(generate("garden", GAUSSIANS[stage]), DEFAULT)
    frame = point_rows(DEFAULT, model, generated_camera("garden"))
    what = case(stage, frame)
    for kind, streams in (("in", what.inputs), ("out", what.expected)):
        for name, rows in streams.items():
            np.save(tmp_path / f"{kind}_{name}.npy", rows)
    run_testbench(
        what.component, "tb.testbenches.stage", simulator="icarus", folder=str(tmp_path),
        constants=what.constants, first=what.first,
    )  # fmt: skip
    for pattern in ("never", "bursts"):
        found = {name: np.load(tmp_path / f"found_{pattern}_{name}.npy") for name in what.expected}
        for name, rows in settled_outputs(stage, DEFAULT, found).items():
            assert (rows == what.expected[name]).all() and len(rows) > 0, f"{pattern} {name}"
