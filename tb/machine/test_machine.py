"""The whole machine in simulation: every pixel and every count is the golden model's."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import IDEAL, LPDDR4, Timing
from splatcore.spec.config import TINY
from splatcore.spec.group import feature_record
from splatcore.spec.sort import half_entries
from splatcore.spec.work import FEATURE
from tb.helpers.machines import check, garden, machine, view
from tb.helpers.needles import long_needles

pytestmark = pytest.mark.slow

NEAR = ("near_plane", "camera_inside")
"""Hard cases with Gaussians at and behind the near plane."""

ROUGH = Timing("rough", latency=37, bandwidth=9.0, granule=32, outstanding=7, stall=0.3)
"""Slow memory that idles at random."""


@pytest.mark.parametrize("timing", [IDEAL, LPDDR4, ROUGH], ids=lambda timing: timing.name)
def test_garden(timing):
    job = Job(garden(TINY, 400), view(), (40, 200, 511))
    check(TINY, job, machine(TINY).run([job], timing))


@pytest.mark.parametrize("name", HARD)
def test_hard_cases(name):
    """Lists of 20,000, equal depths, no Gaussian at all, one pixel, …"""
    case = HARD[name](0)
    job = Job(pack(case.scene, TINY)[0], case.camera)
    run = machine(TINY).run([job])
    check(TINY, job, run)
    if name == "long_list":
        longest = np.diff(render(TINY, *job).start).max()
        assert longest > half_entries(TINY) * TINY.merge_ways**2  # several levels in memory


def test_groups_of_one_tile():
    """The smallest groups, of which tiles and groups have the same numbers."""
    config = replace(TINY, name="TILES", group=1)
    jobs = [Job(garden(TINY, 400), view(*size)) for size in ((64, 48), (33, 17))]
    run = machine(config).run(jobs, LPDDR4)
    for number, job in enumerate(jobs):
        check(config, job, run, number)


def test_long_needles():
    """Whatever is lost of their thickness, E stays within its bits."""
    case = long_needles()
    job = Job(pack(case.scene, TINY)[0], case.camera)
    check(TINY, job, machine(TINY).run([job]))


def test_sizes():
    """Images that end within groups, tiles and blocks, each in memory as wide as it is."""
    jobs = [
        Job(garden(TINY, 150), view(width, height), (0, 0, 300))
        for width, height in ((64, 64), (33, 17), (1, 64), (63, 1), (36, 40), (5, 3))
    ]
    run = machine(TINY).run(jobs, ROUGH)
    for number, job in enumerate(jobs):
        check(TINY, job, run, number)


def test_path():
    """Neighbouring frames in both halves at once; each in the work area of its own."""
    jobs = [Job(garden(TINY, 400), view(step=0.1 * k)) for k in range(5)]
    run = machine(TINY).run(jobs, LPDDR4)
    for number, job in enumerate(jobs):
        check(TINY, job, run, number)
    # Both halves are at work at once: a frame takes as long as its longer half and a bit.
    for frame, first, second in zip(
        run.frame_cycles, run.preprocessing_cycles[1:], run.rendering_cycles[:-1], strict=True
    ):
        assert frame < 1.05 * max(first, second) + 1000


def test_everything_left_out():
    """The ablation's machine: nothing culled, zeros multiplied, no pixel ended early."""
    config = replace(TINY, name="FULL", culling="none", skip_zeros=False, early_termination=False)
    middle = replace(view(), translation=view().translation - [0, 0, 4])
    jobs = [Job(garden(TINY, 400), camera) for camera in (view(), middle)]
    jobs += [Job(pack(HARD[name](0).scene, config)[0], HARD[name](0).camera) for name in NEAR]
    run = machine(config).run(jobs, LPDDR4)
    for number, job in enumerate(jobs):
        check(config, job, run, number)


def test_square():
    """Tiles by the original renderer's square: more pairs, and all else as ever."""
    config = replace(TINY, name="SQUARE", tile_test="3sigma")
    job = Job(garden(config, 400), view(), (40, 200, 511))
    check(config, job, machine(config).run([job], ROUGH))
    pairs = [render(c, *job).counts["tile_pairs"] for c in (config, TINY)]
    assert pairs[0] > 1.2 * pairs[1]


def test_work_area():
    """Features, lists and table in memory are the golden model's."""
    job = Job(garden(TINY, 400), view())
    run = machine(TINY).run([job])
    frame = render(TINY, *job)
    record = feature_record(TINY)
    count = len(frame.binned.kept)
    stored = run.areas.read(run.memory, "features0")[: count * FEATURE].reshape(-1, FEATURE)
    assert np.array_equal(stored[:, : record.size], record.pack(frame.binned.features))
    lists = run.areas.read(run.memory, "lists0").view("<u8").reshape(-1, TINY.burst)
    assert np.array_equal(lists[frame.binned.lists.address], frame.binned.lists.slots)


def test_no_scratch_memory():
    """Lists that fit on chip need none, however little the host has set apart."""
    job = Job(garden(TINY, 60), view())
    assert 0 < np.diff(render(TINY, *job).start).max() <= half_entries(TINY)
    run = machine(TINY).run([job], sizes={"entries": 0})
    check(TINY, job, run)
    assert run.frames[0].counters["rendering_write_scratch"] == 0
