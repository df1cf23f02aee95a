"""The whole machine `DEFAULT` on the built-in scene, on the hard cases of harmonics and on small
real frames."""

from dataclasses import replace

import pytest

from splatcore.golden.pipeline import render
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.machine.machine import Job
from splatcore.sim.machine.script import LPDDR4
from splatcore.spec.config import DEFAULT
from tb.helpers.bounds import HARMONICS
from tb.helpers.machines import check
from tb.helpers.scenes import needs_scenes, scene_path

pytestmark = pytest.mark.slow

SIZE = (480, 270)

WITHIN = 0.06  # maximum relative error of the cycle model for a half that runs alone; it takes
# an average of cycles per block for lanes in quads (skull: 5.1 %)


def run(model, camera, frames: int = 1):
    """Run frames of one camera; compare them with the golden model, their cycles with the model."""
    jobs = [Job(model, camera)] * frames
    found = check(DEFAULT, jobs, LPDDR4)
    model = frame_cycles(DEFAULT, render(DEFAULT, *jobs[0]), LPDDR4)
    for modelled, cycles in (
        (model.preprocessing, found.preprocessing_cycles[0]),
        (model.rendering, found.rendering_cycles[-1]),
    ):
        assert abs(modelled - cycles) < WITHIN * cycles


def test_garden():
    """Two frames of the built-in scene, with both halves busy at once."""
    run(pack(generate("garden"), DEFAULT)[0], generated_camera("garden").resized(*SIZE), 2)


def test_a_tall_image():
    """An image taller than the preset's, but with no more groups; and a small near plane."""
    camera = generated_camera("garden").resized(1920, 1080)
    camera = replace(camera, width=96, height=1920, cx=48.0, cy=960.0, near=0.01)
    job = Job(pack(generate("garden"), DEFAULT)[0], camera)
    check(DEFAULT, [job], LPDDR4)


def test_hard_harmonics():
    """All cases one after the other, each with the two finest qualities."""
    cases = [HARD[name](0) for name in HARMONICS]
    jobs = [
        Job(pack(case.scene, quality=quality)[0], case.camera)
        for case in cases
        for quality in ("faithful", "balanced")
    ]
    check(DEFAULT, jobs)


@needs_scenes
@pytest.mark.parametrize(
    "name, camera",
    [("skull.sog", "0"), pytest.param("kitchen.spz", "kitchen_inside_0", marks=pytest.mark.verify)],
)
def test_scene(name, camera):
    path = scene_path(f"{name.split('.')[0]}.cameras.json")
    view = read_camera(f"{path}:{camera}").resized(*SIZE)
    run(pack(read_scene(scene_path(name)), DEFAULT)[0], view, 2)  # buckets are known from the first
