"""The whole machine in simulation: all pixels and counters are the golden model's; waveforms."""

import re
from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.model.generate.hard import HARD
from splatcore.model.generate.hard_case import HardCase
from splatcore.model.pack.pack import pack
from splatcore.sim.common.preset_file import write_preset
from splatcore.sim.frame.choose import finest
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import IDEAL, LPDDR4, Timing
from splatcore.sim.machine.wave_files import signals
from splatcore.spec.camera import NEAR_LIMITS
from splatcore.spec.config import TINY
from splatcore.spec.sort import BUCKETS, half_entries
from tb.helpers.command import run as command
from tb.helpers.machines import ROUGH, check, garden, long_needles, view

pytestmark = pytest.mark.slow

NEAR = (
    "near_plane",
    "camera_inside",
    "at_the_camera",
)  # hard cases with Gaussians at and behind the near plane

SLOW = Timing("one at a time", latency=20, bandwidth=4.0, outstanding=1)
"""Memory that is busy with another client's access when an image's last row is offered."""

OTHER = replace(
    TINY, name="OTHER", group=1, tile_test="3sigma", culling="none", skip_zeros=False,
    early_termination=False, faint=(), sub_sorters=1, rasterizers=1, port=256, burst=2,
    logic="fpga",
)  # fmt: skip
"""A machine that differs from TINY in every option: groups of one tile; the original renderer's
square tile test; no culling, no skipping of zeros, no early termination; one of each unit; weights
and colours in multipliers; the wide port, wider than some items."""

FIRST, LAST = 300, 420  # cycles whose waveforms are recorded

STREAMS = ("preprocess.points", "preprocess.bin", "render.sort", "render.raster", "axi")
"""Modules whose streams must be in the viewer file of waveforms."""


def finest_job(case: HardCase) -> Job:
    """A hard case, packed as finely as TINY can render."""
    return Job(pack(case.scene, TINY, quality=finest(case.scene, TINY))[0], case.camera)


@pytest.mark.parametrize("timing", [IDEAL, LPDDR4, ROUGH], ids=lambda timing: timing.name)
def test_garden(timing):
    job = Job(garden(TINY, 400), view(), (40, 200, 511))
    check(TINY, [job], timing)


def test_antialiased_garden():
    """A model with compensated opacities, one without, and one with them again."""
    marked = pack(replace(HARD["sub_pixel"](0).scene, antialiased=True), TINY)[0]
    jobs = [Job(model, view(), (40, 200, 511)) for model in (marked, garden(TINY, 400), marked)]
    check(TINY, jobs)


@pytest.mark.parametrize("name", ["near_plane", "camera_inside"])
@pytest.mark.parametrize("near", [NEAR_LIMITS[0], 0.01, 0.5])
def test_near_planes(name, near):
    """Depths below the base of keys are sorted, too."""
    job = finest_job(HARD[name](0))
    jobs = [job._replace(camera=replace(job.camera, near=near)), job]
    frames = [render(TINY, *job).counts["projected"] for job in jobs]
    assert (frames[0] > frames[1]) == (near < 0.2)
    check(TINY, jobs)


@pytest.mark.parametrize("name", HARD)
def test_hard_cases(name):
    """Lists of 20,000 entries, equal depths, no Gaussian, one pixel, …"""
    job = finest_job(HARD[name](0))
    check(TINY, [job])
    if name == "long_list":
        longest = np.diff(render(TINY, *job).start).max()
        assert longest > BUCKETS * half_entries(TINY)  # several rounds of dealing


def test_long_needles():
    """E fits in its bits even though the needles' thickness is lost to rounding."""
    check(TINY, [finest_job(long_needles())])


def test_sizes():
    """Images that end within groups, tiles and blocks, each with its own stride."""
    jobs = [
        Job(garden(TINY, 150), view(width, height), (0, 0, 300))
        for width, height in (
            (64, 64),
            (33, 17),
            (1, 64),
            (63, 1),
            (36, 40),
            (5, 3),
            (127, 32),
            (31, 127),
        )
    ]
    check(TINY, jobs, ROUGH)


@pytest.mark.parametrize("size", [(31, 3), (33, 17), (16, 16), (64, 3)])
def test_last_row_is_in_memory_before_the_frame_is_told(size):
    """Even while the other half keeps the port busy."""
    jobs = [Job(garden(TINY, 150), view(*size)), Job(garden(TINY, 400), view())]
    check(TINY, jobs, SLOW)


def test_path():
    """Consecutive frames in both halves at once, each in its own work area."""
    jobs = [Job(garden(TINY, 400), view(step=0.1 * k)) for k in range(5)]
    run = check(TINY, jobs, LPDDR4)
    # Both halves work at once: a frame takes little longer than its slower half.
    for frame, first, second in zip(
        run.frame_cycles, run.preprocessing_cycles[1:], run.rendering_cycles[:-1], strict=True
    ):
        assert frame < 1.05 * max(first, second) + 1000


@pytest.mark.verify
@pytest.mark.parametrize("timing", [LPDDR4, ROUGH], ids=lambda timing: timing.name)
def test_other_choices(timing):
    jobs = [Job(garden(OTHER, 400), view(*size), (40, 200, 511)) for size in ((64, 48), (33, 17))]
    middle = replace(view(), translation=view().translation - [0, 0, 4])
    jobs.append(Job(garden(OTHER, 400), middle))
    cases = [HARD[name](0) for name in NEAR]
    jobs += [Job(pack(case.scene, OTHER)[0], case.camera) for case in cases]
    check(OTHER, jobs, timing)
    pairs = [render(config, *jobs[0]).counts["tile_pairs"] for config in (OTHER, TINY)]
    assert pairs[0] > 1.2 * pairs[1]


@pytest.mark.verify
def test_waves_of_a_window(tmp_path):
    """Only the window is recorded, and the viewer file shows only recorded signals."""
    preset, vcd = tmp_path / "other.toml", tmp_path / "w.vcd"
    write_preset(preset, OTHER, TINY)
    assert command("simulate", "needles", "--preset", preset, "--size", "16x16",
                   "-o", tmp_path / "w.png", "--waves", vcd,
                   "--window", f"{FIRST}:{LAST}") == 0  # fmt: skip
    times = [int(line[1:]) for line in vcd.read_text().splitlines() if line.startswith("#")]
    assert times[0] // 10 >= FIRST and times[-1] // 10 <= LAST + 1
    assert len({time // 10 for time in times}) >= LAST - FIRST
    names = {f"{signal.scope}.{signal.name}" for signal in signals(vcd)}
    view = (tmp_path / "w.gtkw").read_text().splitlines()
    shown = [re.sub(r"\[.*", "", line) for line in view if line.startswith("TOP.top.")]
    assert shown and set(shown) <= names
    for module in STREAMS:
        assert any(line.startswith(f"TOP.top.{module}.") for line in shown), module


def test_short_lists_are_not_dealt():
    job = Job(garden(TINY, 60), view())
    assert 0 < np.diff(render(TINY, *job).start).max() <= half_entries(TINY)
    run = check(TINY, [job])
    assert run.frames[0].counters["rendering_write_buckets"] == 0
