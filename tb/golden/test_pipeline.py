"""The golden model of the whole machine against the float64 reference: PSNR of its pictures."""

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generated_camera
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.choose import finest
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.metric import psnr_of_square
from tb.helpers.bounds import BOUND, RULE
from tb.helpers.machines import garden
from tb.helpers.scenes import needs_scenes, scene_path


def psnr(model, camera, rule=SPLATCORE) -> float:
    """Return the PSNR in dB of the golden 8-bit picture against the reference, at most 120."""
    frame = render(DEFAULT, model, camera)
    reference = render_reference(model.gaussians(), camera, rule).image
    error = frame.pixels / 255 - np.clip(reference, 0, 1)
    return psnr_of_square(max(float(np.mean(error**2)), 1e-12))


@pytest.mark.parametrize("name", HARD)
def test_hard_cases(name):
    """Against the reference with the faintness rule; `test_faint` tests the rule itself."""
    case = HARD[name](0)
    model, _ = pack(case.scene, DEFAULT, quality=finest(case.scene, DEFAULT))
    assert psnr(model, case.camera, RULE) >= BOUND


def test_garden():
    assert psnr(garden(DEFAULT, 5_000), generated_camera("garden", 480, 270)) >= BOUND


@needs_scenes
@pytest.mark.slow
@pytest.mark.parametrize("name", ["skull.sog", "guitar.compressed.ply", "luma-seal.splat"])
def test_scenes(name):
    model, _ = pack(read_scene(scene_path(name)), DEFAULT)
    camera = read_camera(f"{scene_path(name.split('.')[0] + '.cameras.json')}:0")
    assert psnr(model, camera) >= BOUND
