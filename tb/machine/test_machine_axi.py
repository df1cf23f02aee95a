"""The whole machine between the memory and the host of `cocotbext-axi`."""

import pytest

from splatcore.hdl.top import Top
from splatcore.sim.rtl.cocotb_runner import run_testbench
from splatcore.spec.config import TINY


@pytest.mark.slow
@pytest.mark.parametrize(
    "pattern",
    ["bursts", *(pytest.param(p, marks=pytest.mark.verify) for p in ("never", "at_random"))],
)
def test_frames(pattern):
    run_testbench(Top(TINY), "tb.testbenches.machine", pattern=pattern)
