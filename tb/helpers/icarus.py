"""Components with streams under Icarus, an independent simulator, without stalls and in bursts."""

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from amaranth.lib import wiring

from splatcore.sim.rtl.cocotb_runner import run_testbench
from tb.helpers.runs import Rows

needs_icarus = pytest.mark.skipif(
    not shutil.which("iverilog"), reason="needs Icarus: apt-get install iverilog"
)


def check_under_icarus(
    component: wiring.Component,
    folder: Path,
    inputs: Rows,
    expected: Rows,
    constants: dict[str, int],
    first: Iterable[str] = (),
    settled: Callable[[Rows], Rows] = lambda rows: rows,
) -> None:
    """Compare all rows of all out streams. settled: leaves what matters of the rows found."""
    for kind, streams in (("in", inputs), ("out", expected)):
        for name, rows in streams.items():
            np.save(folder / f"{kind}_{name}.npy", rows)
    run_testbench(
        component, "tb.testbenches.stage", simulator="icarus", folder=str(folder),
        constants=constants, first=list(first),
    )  # fmt: skip
    for pattern in ("never", "bursts"):
        found = {name: np.load(folder / f"found_{pattern}_{name}.npy") for name in expected}
        for name, rows in settled(found).items():
            assert len(rows) > 0
            np.testing.assert_array_equal(rows, expected[name], f"{pattern} {name}")
