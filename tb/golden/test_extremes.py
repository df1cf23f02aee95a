"""Gaussians with finite values of any size: the reference and the gradient kernels render or count
them. Catches overflows in conversions to integers."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.gradients.drawn import blending_weights
from splatcore.spec.convention import ORIGINAL, SPLATCORE
from splatcore.spec.scene import ARRAYS
from tb.helpers.clouds import camera, cloud
from tb.helpers.floaters import EXTREME, with_extremes

HUGE = (44.0, 88.0, 300.0, 700.0)  # logarithms of scales, as PLY files hold them


@pytest.mark.parametrize("convention", (SPLATCORE, ORIGINAL), ids=("exact", "3sigma"))
@pytest.mark.parametrize("name", ARRAYS)
def test_reference(name, convention):
    scene = cloud(1, degree=3)
    for value in EXTREME:
        for count in (1, len(scene)):
            gaussians = with_extremes(scene, name, value, count).gaussians()
            frame = render(gaussians, camera(), convention)
            assert np.isfinite(frame.transmittance).all(), (value, count)
            assert (frame.transmittance >= 0).all() and (frame.transmittance <= 1).all()
            list(blending_weights(gaussians, [camera()]))


@pytest.mark.parametrize("scale", HUGE)
def test_gaussians_larger_than_any_integer_cover_the_picture(scale):
    """They equal Gaussians of scale 1e9, with one alpha at every pixel, or are counted."""
    scene = cloud(2)
    huge, large = (replace(scene, scale=np.full((len(scene), 3), s)) for s in (np.exp(scale), 1e9))
    frame, expected = (render(s.gaussians(), camera()) for s in (huge, large))
    if scale < 300:
        np.testing.assert_allclose(frame.image, expected.image, atol=1e-9)
    else:  # squares overflow: shown or counted
        assert frame.counts["visible"] + frame.counts["not_finite"] > 0
    assert frame.counts["pairs"] >= frame.counts["visible"]
    weights = next(blending_weights(huge.gaussians(), [camera()]))
    assert weights.any() or scale >= 88
