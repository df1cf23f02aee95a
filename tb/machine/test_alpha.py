"""Images with alpha on the whole machine: all bytes are the golden model's."""

import pytest

from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import LPDDR4
from tb.helpers.configs import ALPHA
from tb.helpers.machines import check, garden, view


@pytest.mark.slow
def test_formats_in_turn():
    """With alpha, and with a background, which frames with alpha ignore; groups without splats."""
    jobs = [
        Job(garden(ALPHA, 150), view(*size), (40, 200, 511), rgba)
        for size, rgba in (((64, 48), True), ((61, 35), False), ((33, 17), True), ((64, 64), True))
    ]
    check(ALPHA, jobs, LPDDR4)
