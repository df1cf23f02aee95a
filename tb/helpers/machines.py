"""Models, cameras and a check of frames for tests of the whole machine."""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.golden.pipeline import render
from splatcore.model.generate import hard_case
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.counted import attribute_beats, counted
from splatcore.sim.machine.machine import Job, Run
from splatcore.sim.machine.script import IDEAL, Timing
from splatcore.sim.soak.machines import machine
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.packed import PackedModel

NEEDLES = 100
LENGTHS = 30, 30 * hard_case.WIDTH
THIN = 1e-5


@cache
def garden(config: Config, gaussians: int) -> PackedModel:
    """A small garden, packed."""
    return pack(generate("garden", gaussians), config)[0]


def view(width: int = 64, height: int = 48, step: float = 0.0) -> Camera:
    """The garden's camera, moved sideways."""
    camera = generated_camera("garden", width, height)
    return replace(camera, translation=camera.translation - [step, 0, 0])


def long_needles() -> hard_case.HardCase:
    """Needles in all directions, up to thousands of pixels long and 1e5 times as long as thick, so
    that all digits of their covariances' determinants cancel."""
    pixels = np.geomspace(*LENGTHS, NEEDLES)[:, None]
    scale = pixels * hard_case.DEPTH / hard_case.FOCAL * [1, THIN, THIN]
    scene = replace(hard_case.spread(np.random.default_rng(0), NEEDLES), scale=scale)
    camera = hard_case.straight_camera()
    return hard_case.HardCase(scene, camera, "lengths up to 30 times the screen's width")


ROUGH = Timing("rough", latency=37, bandwidth=9.0, granule=32, outstanding=7, stall=0.3)
"""Slow memory with random stalls."""


def check(config: Config, jobs: list[Job], timing: Timing = IDEAL) -> Run:
    """Render frames on the machine; compare their pixels and counters with the golden model's."""
    run = machine(config).run(jobs, timing)
    assert run.done, run.why
    assert not run.report.outside, run.why
    for rendered, job in zip(run.frames, jobs, strict=True):
        frame, read = render(config, *job), rendered.counters
        assert np.array_equal(rendered.pixels, frame.pixels)
        wanted = {name: n for name, n in counted(config, job.model, frame).items() if name in read}
        assert {name: read[name] for name in wanted} == wanted
        least, most = attribute_beats(config, job.model, frame)
        assert least <= read.get("preprocessing_read_attributes", most) <= most
    return run
