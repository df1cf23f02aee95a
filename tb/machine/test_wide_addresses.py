"""64-bit addresses: each area in its own window of 4 GiB, two frames in flight."""

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.sim.machine.areas import place_areas
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.axi import ADDRESS_BITS
from splatcore.spec.config import TINY
from splatcore.spec.registers import high_registers
from splatcore.spec.sort import half_entries
from tb.helpers.configs import wide_addresses
from tb.helpers.machines import ROUGH, check, garden, view

pytestmark = pytest.mark.slow

WIDE = wide_addresses(TINY)

FRAMES = 4


def jobs() -> list[Job]:
    """A frame with short lists, then consecutive frames of two models with lists that are dealt."""
    dealt = [Job(garden(WIDE, 400 - 50 * (k % 2)), view(step=0.1 * k)) for k in range(FRAMES)]
    return [Job(garden(WIDE, 40), view()), *dealt]


@pytest.mark.verify
@pytest.mark.parametrize("timing", [LPDDR4, ROUGH], ids=lambda timing: timing.name)
def test_each_area_in_a_window_of_its_own(timing):
    """Other windows answer by errors, and no two areas have the same address within a window."""
    given = jobs()
    run = check(WIDE, given, timing)
    assert np.diff(render(WIDE, *given[0]).start).max() <= half_entries(WIDE)
    assert run.frames[-1].counters["rendering_write_buckets"]
    regions = run.areas.regions
    assert len({region.begin >> ADDRESS_BITS for region in regions}) == len(regions)
    assert len({region.begin % (1 << ADDRESS_BITS) for region in regions}) == len(regions)
    assert all(region.begin >> ADDRESS_BITS for region in regions)
    overlap = [b.started < a.finished for a, b in zip(run.frames, run.frames[1:], strict=False)]
    assert all(overlap)  # two frames in flight


def test_frames_in_flight_differ_in_every_window():
    """Except in the window of scratch memory, which only one frame uses at a time."""
    models = [job.model for job in jobs()[:2]]
    areas = place_areas(WIDE, models, [(64, 48)])
    first, second = (frame_values(WIDE, job, k, areas, k) for k, job in enumerate(jobs()[:2]))
    names = [register.name for register in high_registers(WIDE)]
    assert [name for name in names if first[name] == second[name]] == ["SCRATCH_HIGH"]
