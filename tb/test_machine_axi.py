"""The whole machine between the memory and the host of `cocotbext-axi`."""

import pytest

from hdl.top import Top
from sim.bench import run_bench
from spec.config import TINY


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["never", "at_random", "bursts"])
def test_frames(pattern):
    run_bench(Top(TINY), "tb.bench_machine", pattern=pattern)
