"""The host's registers under the AXI4-Lite master of `cocotbext-axi`."""

import pytest

from splatcore.hdl.registers import Registers
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.spec.config import DEFAULT


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.verify)])
def test_host(seed):
    run_testbench(Registers(DEFAULT), "tb.testbenches.registers", seed=seed)
