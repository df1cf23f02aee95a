"""Models with floaters, padding and extreme numbers in RTL: every pixel is the golden model's."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.pack.pack import pack
from splatcore.sim.machine.machine import Job
from splatcore.sim.soak.machines import machine
from splatcore.spec.config import TINY
from tb.helpers.clouds import camera, cloud
from tb.helpers.floaters import ball, strewn, with_extremes
from tb.helpers.machines import check

pytestmark = pytest.mark.slow


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
    jobs = [Job(model, camera(48, 32), (40, 200, 511)) for model, _ in packed]
    check(TINY, machine(TINY).run(jobs), *jobs)
