"""The Gaussians that the browser draws: chosen by size and opacity, in the renderer's colours."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.app.view.drawn import base_colours, drawn_by_browser
from splatcore.app.view.text import drawn_text
from splatcore.golden import reference
from splatcore.model.generate.generate import generate
from splatcore.spec import scene
from splatcore.spec.camera import look_at
from splatcore.spec.scene import Gaussians


def balls(size, opacity, colour=0.0) -> Gaussians:
    """Spheres in a row, of given standard deviations and opacities."""
    count = len(size)
    position = np.stack([np.arange(count), *np.zeros((2, count))], axis=1)
    factor = np.eye(3) * np.asarray(size, float)[:, None, None]
    sh = np.broadcast_to(colour, (count, 1, 3)).astype(float)
    return Gaussians(position, factor, np.asarray(opacity, float), sh)


def test_arrays():
    """The browser gets the scene's centres and covariances in units of `scale`, no broken ones."""
    gaussians = generate("garden", 400).gaussians()
    found = drawn_by_browser(gaussians)
    assert len(found) == found.total == 400
    factor, arrays = gaussians.factor[5], found.arrays
    covariance = arrays["covariances"][5].astype(np.float16).astype(float) * arrays["scale"] ** 2
    np.testing.assert_allclose(covariance, factor @ factor.T, rtol=1e-3, atol=1e-7)
    np.testing.assert_allclose(found.position, gaussians.position, rtol=1e-6)
    np.testing.assert_array_equal(arrays["opacities"][:, 0], np.rint(gaussians.opacity * 255))
    gaussians.position[3], gaussians.opacity[7] = np.nan, 0.001
    gaussians.factor[9] = np.inf
    assert len(drawn_by_browser(gaussians)) == 397


def test_small_scenes_keep_their_shapes():
    """Covariances of a scene in small units would become 0 as float16."""
    found = drawn_by_browser(balls([1e-5, 2e-5, 4e-5], [1, 1, 1])).arrays
    sent = found["covariances"].astype(np.float16)[:, 0, 0].astype(float)
    np.testing.assert_allclose(np.sqrt(sent) * found["scale"], [1e-5, 2e-5, 4e-5], rtol=1e-3)


def test_the_subset_is_chosen_by_size_and_opacity(monkeypatch):
    """The largest products of opacity and area remain, in stored order, whatever the batches."""
    gaussians = balls([1, 3, 2, 9, 1, 2.5], [1, 0.5, 1, 0.001, 0.5, 0.2])
    for batch in (2, 100):
        monkeypatch.setattr(scene, "BATCH", batch)
        for most, chosen in (1, [1]), (2, [1, 2]), (3, [1, 2, 5]), (9, [0, 1, 2, 4, 5]):
            found = drawn_by_browser(gaussians, most)
            np.testing.assert_allclose(found.position[:, 0], chosen)
    text = drawn_text(drawn_by_browser(gaussians, 3))
    assert text.endswith("3 of 6 Gaussians (the largest and most opaque)*")
    assert drawn_text(drawn_by_browser(balls([1], [1]))).endswith("base colours of 1 Gaussians*")


def test_a_needle_covers_less_than_a_disc():
    gaussians = balls([1, 1, 1], [1, 1, 1])
    gaussians.factor[0], gaussians.factor[2] = np.diag([5, 0.01, 0.01]), np.diag([1.1, 1.1, 0])
    assert drawn_by_browser(gaussians, 2).position[:, 0] == pytest.approx([1, 2])


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_base_colours_are_the_reference_s(degree):
    """An opaque Gaussian of one base colour has this colour in the reference's picture."""
    camera = look_at((0.0, 0, -5), (0.0, 0, 0), 9, 9, 8.0)
    for colour in ([0.9, -0.3, 0.05], [-2, 0.0, 4], [1.0, 1.7, -1.7]):
        ball = balls([4], [1.0], colour)
        ball = replace(ball, sh=np.pad(ball.sh, ((0, 0), (0, (degree + 1) ** 2 - 1), (0, 0))))
        pixel = reference.render(ball, camera).pixels[4, 4].astype(int)
        np.testing.assert_allclose(base_colours(ball)[0], pixel, atol=3.1)  # alpha is at most 0.99
        assert drawn_by_browser(ball).arrays["rgbs"].dtype == np.uint8
