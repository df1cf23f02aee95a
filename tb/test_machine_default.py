"""The whole machine of `DEFAULT` on the embedded scene and on small real frames."""

import pytest

from golden.pipeline import render
from model.camera_file import read_camera
from model.generate import generate, generated_camera
from model.pack import pack
from model.read import read_scene
from sim.cycles import frame_cycles
from sim.machine import Job
from sim.machine_script import LPDDR4
from spec.config import DEFAULT
from tb.machines import check, machine
from tb.scenes import needs_scenes, scene_path

pytestmark = pytest.mark.slow

SIZE = (480, 270)

WITHIN = 0.05
"""How far off the cycle model of a half may be, whichever half is alone at work."""


def run(model, camera, frames: int = 1):
    """Frames of one camera, all of them the twin's."""
    job = Job(model, camera)
    found = machine(DEFAULT).run([job] * frames, LPDDR4)
    for number in range(frames):
        check(DEFAULT, job, found, number)
    model = frame_cycles(DEFAULT, render(DEFAULT, *job), LPDDR4)
    for modelled, cycles in (
        (model.preprocessing, found.preprocessing_cycles[0]),
        (model.rendering, found.rendering_cycles[-1]),
    ):
        assert abs(modelled - cycles) < WITHIN * cycles


def test_garden():
    """Two frames of the embedded scene, both halves at work at once."""
    run(pack(generate("garden"), DEFAULT)[0], generated_camera("garden").resized(*SIZE), 2)


@needs_scenes
@pytest.mark.parametrize("name, camera", [("skull.sog", "0"), ("kitchen.spz", "kitchen_inside_0")])
def test_scene(name, camera):
    path = scene_path(f"{name.split('.')[0]}.cameras.json")
    view = read_camera(f"{path}:{camera}").resized(*SIZE)
    run(pack(read_scene(scene_path(name)), DEFAULT)[0], view)
