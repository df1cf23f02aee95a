"""The reference renderer against gsplat's CPU path, an independent implementation.

gsplat's results are stored in `tb/outside`, with the script that made them.
"""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.spec.convention import NEAR_PLANE, Convention, Faint
from splatcore.spec.scene import sh_count
from tb.outside.scenes import CASES
from tb.outside.stored import ATTRIBUTES, FOLDER, GSPLAT, VERSIONS, Stored, load

ERROR_MAX = 1e-6
"""Largest difference of any pixel; 6e-8 is measured, the rounding of the stored files."""

EFFECT_MIN = 1e-4  # effect of a slightly wrong convention on some pixel of some scene, at least

SLIGHTLY_WRONG = {
    "near": 0.21,
    "frustum_margin": 1.25,
    "covariance_blur": 0.31,
    "alpha_min": 1 / 250,
    "alpha_max": 0.99,
    "transmittance_min": 2e-4,
    "faint": Faint(dark=2**-5, taken=2**-11, ends=2**-9),
    "pixel_centre": 0.51,
    "principal_point_shift": 0.01,
    "colour_offset": 0.51,
    "footprint": "3sigma",
    "background": (0.01, 0.01, 0.01),
}

stored = cache(load)


def errors(file: Stored, **changes) -> tuple[float, float]:
    """Return the largest difference of image and of transmittance, with changed conventions."""
    camera = replace(file.case.camera, near=changes.pop("near", NEAR_PLANE))
    convention = replace(GSPLAT, **{"background": file.case.background, **changes})
    frame = render(file.case.scene.gaussians(), camera, convention)
    image = np.abs(frame.image - file.image).max()
    return image, np.abs(frame.transmittance - file.transmittance).max()


@pytest.mark.parametrize("name", CASES)
def test_reference_equals_gsplat(name):
    image, transmittance = errors(stored(name))
    assert image <= ERROR_MAX, f"image differs by {image:.2e}"
    assert transmittance <= ERROR_MAX, f"transmittance differs by {transmittance:.2e}"


@pytest.mark.parametrize("name", CASES)
def test_integer_pixel_centres_are_the_same(name):
    """Sampling pixels at +0.5 equals sampling at integers with the principal point shifted."""
    image, transmittance = errors(stored(name), pixel_centre=0.0, principal_point_shift=0.5)
    assert max(image, transmittance) <= ERROR_MAX, f"{image:.2e}, {transmittance:.2e}"


@pytest.mark.parametrize("field", ["near", *(field.name for field in fields(Convention))])
def test_every_convention_matters(field):
    """A slightly wrong value of any convention changes at least one of the stored scenes."""
    change = {field: SLIGHTLY_WRONG[field]}
    effect = {name: float(errors(stored(name), **change)[0]) for name in CASES}
    assert max(effect.values()) > EFFECT_MIN, f"{field}: {effect}"


@pytest.mark.parametrize("name", CASES)
def test_antialiased_flag_matters(name):
    """With the scene's `antialiased` flag flipped, the image differs visibly from gsplat's."""
    file = stored(name)
    scene = replace(file.case.scene, antialiased=not file.case.scene.antialiased)
    other = replace(file, case=replace(file.case, scene=scene))
    assert errors(other)[0] > 0.03


@pytest.mark.parametrize("name", CASES)
def test_file_holds_what_the_script_declares(name):
    file, case = stored(name), CASES[name]()
    assert file.versions == VERSIONS
    scene, camera = file.case.scene, file.case.camera
    for attribute in ("width", "height", "fx", "fy", "cx", "cy", "rotation", "translation"):
        np.testing.assert_allclose(getattr(camera, attribute), getattr(case.camera, attribute))
    for attribute in ATTRIBUTES:  # not bit for bit: exp and log vary between machines
        declared = getattr(case.scene, attribute)
        np.testing.assert_allclose(getattr(scene, attribute), declared, rtol=1e-6)
    assert file.case.background == case.background
    assert scene.antialiased == case.scene.antialiased
    assert scene.sh.shape == (len(scene), sh_count(case.scene.sh_degree), 3)
    assert file.image.shape == (camera.height, camera.width, 3)
    assert file.transmittance.shape == (camera.height, camera.width)
    assert camera.width % 16 and camera.height % 16 and camera.fx != camera.fy
    for array in (file.image, file.transmittance):
        assert np.isfinite(array).all() and array.min() >= 0 and np.ptp(array) > 0.5


def test_no_file_is_missing_or_left_over():
    assert {path.stem for path in FOLDER.glob("*.npz")} == set(CASES)
