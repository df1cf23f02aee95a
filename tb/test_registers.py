"""The host's registers under the AXI4-Lite master of `cocotbext-axi`."""

import pytest

from hdl.registers import Registers
from sim.bench import run_bench
from spec.config import DEFAULT


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_host(seed):
    run_bench(Registers(DEFAULT), "tb.bench_registers", seed=seed)
