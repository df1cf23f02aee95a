"""Whole pictures: PSNR of the golden model against the float64 reference; the reference and the
gradient kernels on Gaussians with finite values of any size; work counts of real frames."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render
from splatcore.golden.reference import render as render_reference
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generated_camera
from splatcore.model.generate.hard import HARD
from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.choose import finest
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import ORIGINAL, SPLATCORE
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.scene import ARRAYS
from tb.helpers.bounds import BOUND, RULE
from tb.helpers.clouds import camera, cloud
from tb.helpers.floaters import EXTREME, with_extremes
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


HUGE = (44.0, 88.0, 300.0, 700.0)  # logarithms of scales, as PLY files hold them


@pytest.mark.parametrize("convention", (SPLATCORE, ORIGINAL), ids=("exact", "3sigma"))
@pytest.mark.parametrize("name", ARRAYS)
def test_extremes(name, convention):
    scene = cloud(1, degree=3)
    for value in EXTREME:
        for count in (1, len(scene)):
            gaussians = with_extremes(scene, name, value, count).gaussians()
            frame = render_reference(gaussians, camera(), convention)
            assert np.isfinite(frame.transmittance).all(), (value, count)
            assert (frame.transmittance >= 0).all() and (frame.transmittance <= 1).all()
            list(blending_weights(gaussians, [camera()]))


@pytest.mark.parametrize("scale", HUGE)
def test_gaussians_larger_than_any_integer_cover_the_picture(scale):
    """They equal Gaussians of scale 1e9, with one alpha at every pixel, or are counted."""
    scene = cloud(2)
    huge, large = (replace(scene, scale=np.full((len(scene), 3), s)) for s in (np.exp(scale), 1e9))
    frame, expected = (render_reference(s.gaussians(), camera()) for s in (huge, large))
    if scale < 300:
        np.testing.assert_allclose(frame.image, expected.image, atol=1e-9)
    else:  # squares overflow: shown or counted
        assert frame.counts["visible"] + frame.counts["not_finite"] > 0
    assert frame.counts["pairs"] >= frame.counts["visible"]
    weights = next(blending_weights(huge.gaussians(), [camera()]))
    assert weights.any() or scale >= 88


WITHIN = 0.01

COLUMNS = (
    "gaussians", "visible", "pairs_3sigma", "pairs", "pairs_after_termination", "blocks",
    "contributions", "tile_list_mean", "tile_list_p99", "tile_list_max", "tile_rows",
)  # fmt: skip

TABLE = {
    "flowers.spz": "542104 405k 4.22M 1.71M 1.50M 7.9M 80M 210 847 1220 0.90M",
    "playbot.spz": "500k 432k 4.30M 1.77M 1.69M 8.1M 79M 216 1025 1521 0.82M",
    "skull.sog": "95k 89k 7.57M 1.53M 1.14M 9.7M 126M 187 860 1294 0.43M",
    "luma-seal.splat": "102k 96k 3.69M 0.97M 0.71M 5.5M 68M 119 849 1172 0.25M",
    "kitchen.spz": "214k 118k 3.56M 1.46M 1.08M 9.9M 132M 179 407 458 0.41M",
}
"""Counts for camera 0 of each scene, opacities as stored, rounded to the digits shown."""

CULLED = {"flowers.spz": 0.02, "playbot.spz": 0, "skull.sog": 0, "luma-seal.splat": 0,
          "kitchen.spz": 0.01}  # fmt: skip
"""Fraction of Gaussians culled by the near plane, rounded to a percent."""


def printed(text: str) -> tuple[float, float]:
    """Return the value of a printed figure, and half a unit of its last digit."""
    unit = {"k": 1e3, "M": 1e6}.get(text[-1], 1)
    digits = text.rstrip("kM")
    return float(digits) * unit, unit * 0.5 / 10 ** len(digits.partition(".")[2])


@pytest.mark.slow
@needs_scenes
@pytest.mark.parametrize("file", TABLE)
def test_counts(file):
    scene = replace(read_scene(scene_path(file)).with_sh_degree(1), antialiased=False)
    view = read_camera(f"{scene_path(file.split('.')[0] + '.cameras.json')}:0")
    assert (view.width, view.height) == (1920, 1080)
    counts = render_reference(scene.gaussians(), view).counts
    assert round(counts["near_culled"] / counts["gaussians"], 2) == CULLED[file]
    for column, expected in zip(COLUMNS, TABLE[file].split(), strict=True):
        value, rounding = printed(expected)
        bound = WITHIN * value + rounding
        assert abs(counts[column] - value) <= bound, (column, counts[column], expected)
