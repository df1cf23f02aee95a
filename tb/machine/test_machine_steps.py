"""The whole machine on models of all kinds: layouts, degrees, skipped chunks, extreme numbers."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.model.generate.generate import generate
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import IDEAL
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import TINY
from splatcore.spec.memory import CHUNK
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene
from tb.helpers.clouds import camera as facing
from tb.helpers.clouds import cloud
from tb.helpers.floaters import ball, strewn, with_extremes
from tb.helpers.machines import ROUGH, check, view
from tb.stages.points import with_harmonics

COUNT = 3000
LAYOUT_OF = np.random.default_rng(2).integers(0, len(LAYOUTS), -(-COUNT // CHUNK))

AMID = replace(view(), translation=view().translation - [0, 0, 8])
"""A camera with a part of the garden behind it."""

pytestmark = pytest.mark.slow


def scene() -> Scene:
    """The garden with random harmonics of degree 3."""
    return with_harmonics(generate("garden", COUNT), np.random.default_rng(1))


def models() -> list[PackedModel]:
    """Models in steps with all layouts and degrees, and compact and small ones."""
    kinds = [(None, quality) for quality in (LAYOUT_OF, "faithful", "small", "balanced", "compact")]
    kinds += [(degree, quality) for degree in (0, 1) for quality in ("faithful", "compact")]
    kinds += [(0, "small")]
    return [pack(scene(), TINY, degree, quality=quality)[0] for degree, quality in kinds]


@pytest.mark.parametrize(
    "timing", [IDEAL, pytest.param(ROUGH, marks=pytest.mark.verify)], ids=lambda timing: timing.name
)
def test_frames_of_all_kinds_of_models(timing):
    """Frames one after the other: no state of a model remains for the next one."""
    jobs = [Job(model, camera) for model in models() for camera in (AMID, view(40, 36, 1))]
    read = render(TINY, *jobs[0]).points.read
    assert read[-1] and (jobs[0].model.chunk_beats[~read] > 1).any()
    check(TINY, jobs, timing)


def test_extremes():
    """Floaters; scales beyond any integer; positions and coefficients far beyond the others'."""
    scene = cloud(3, count=80)
    scenes = [
        replace(strewn(ball(300), 3, 1e6), antialiased=True),
        strewn(ball(300), 3, 1e6),
        replace(scene, scale=np.full((80, 3), np.exp(44.0))),
        with_extremes(scene, "scale", 3e38, 2),
        with_extremes(scene, "position", 1e30, 40),
        with_extremes(scene, "sh", 1e30, 3),
        with_extremes(scene, "quaternion", 1e-38, 80),
    ]
    packed = [pack(each, TINY, quality="faithful") for each in scenes]
    assert [report.padding for _, report in packed[:2]] == [215, 215]
    jobs = [Job(model, facing(48, 32), (40, 200, 511)) for model, _ in packed]
    check(TINY, jobs)
