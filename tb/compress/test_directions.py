"""Directions in which views see each Gaussian, and the slopes nearest in these directions."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.compress.codebooks import assign_slopes, in_codebooks
from splatcore.model.compress.judge import decibels
from splatcore.model.compress.significance import ELSEWHERE, Directions, directions_of
from splatcore.model.compress.teacher import pictures
from splatcore.model.generate.generate import generated_camera
from splatcore.model.gradients.drawn import blending_weights
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT
from tb.helpers.compression_scene import SIZE


@pytest.fixture(scope="module")
def seen(scene, cameras) -> Directions:
    return directions_of(scene, cameras)


@pytest.fixture(scope="module")
def rays(scene, cameras) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [N, V, 3] from the cameras, and their weights [N, V]."""
    ray = scene.position[:, None] - np.array([camera.position for camera in cameras])
    weights = blending_weights(scene.gaussians(), cameras)
    weight = np.stack(list(weights), axis=1).astype(np.float64)
    return ray / np.linalg.norm(ray, axis=2, keepdims=True), weight


def test_directions(seen, rays):
    """Weighted mean and variance of the directions, against numpy."""
    for mean, variance, ray, weight in zip(seen.mean, seen.variance, *rays, strict=True):
        if not weight.any():
            assert not mean.any() and np.allclose(variance, ELSEWHERE * np.eye(3))
            continue
        wanted = np.cov(ray.T, aweights=weight, ddof=0)
        assert np.allclose(mean, np.average(ray, axis=0, weights=weight))
        assert np.allclose(variance - ELSEWHERE * np.eye(3), wanted, atol=1e-9)
    assert (rays[1].sum(axis=1) > 0).mean() > 0.9


def test_a_gaussian_in_a_camera(scene, cameras):
    """A Gaussian at a camera's position has no direction there, and still finite results."""
    position = scene.position.copy()
    position[3] = cameras[0].position
    found = directions_of(replace(scene, position=position), cameras)
    assert np.isfinite(found.mean).all() and np.isfinite(found.variance).all()


def test_nearest_is_nearest_in_colour(seen, rays):
    """Least squared error of colours about their mean, which the constant term can absorb."""
    rng = np.random.default_rng(0)
    ray, weight = rays
    slopes, entries = rng.normal(0, 1, (len(ray), 9)), rng.normal(0, 1, (16, 9))
    found = seen.nearest(slopes, entries)
    for n in np.flatnonzero(weight.sum(axis=1) > 0):
        off = (slopes[n] - entries).reshape(-1, 3, 3)  # [K, channel, axis]
        colour = off @ ray[n].T  # [K, channel, V]
        mean = np.average(colour, axis=2, weights=weight[n])
        about = np.average((colour - mean[..., None]) ** 2, axis=2, weights=weight[n])
        wanted = about.sum(axis=1) + ELSEWHERE * (off**2).sum(axis=(1, 2))
        assert wanted[found[n]] <= wanted.min() * (1 + 1e-9)


def test_colours_make_up_for_slopes(seen, rays):
    """The constant term absorbs lost slopes: the mean colour over the views does not change."""
    rng = np.random.default_rng(1)
    colours, missing = rng.random((len(seen.mean), 3)), rng.normal(0, 1, (len(seen.mean), 9))
    made_up = seen.compensated(colours, missing)
    ray, weight = rays
    shown = weight.sum(axis=1) > 0
    lost = np.einsum("nca,nva->nvc", missing.reshape(-1, 3, 3), ray)[shown]
    lost = np.stack(
        [np.average(a, axis=0, weights=w) for a, w in zip(lost, weight[shown], strict=True)]
    )
    assert np.allclose(made_up[shown] - colours[shown], lost)
    assert np.array_equal(made_up[~shown], colours[~shown])


def on_a_line(camera: Camera) -> list[Camera]:
    """Eight cameras on a line from left to right through this one."""
    steps = np.outer(np.linspace(-2, 2, 8), (1, 0, 0))
    return [replace(camera, translation=camera.translation + step) for step in steps]


def test_directions_improve_models(scene):
    """Absorbing lost slopes gains over 5 dB, nearest slopes by view directions 0.1 dB more."""
    sh = np.random.default_rng(0).normal(0, 0.3, (len(scene), 4, 3))
    sh[:, 0] = scene.sh[:, 0]
    strong = replace(scene, sh=sh)
    views = on_a_line(generated_camera("garden").resized(*SIZE))
    shown, seen = pictures(strong, views), directions_of(strong, views)
    found = []
    for mean, variance in ((1, 1), (1, 0), (0, 1), (0, 0)):
        each = Directions(mean * seen.mean, variance * seen.variance + (1 - variance) * np.eye(3))
        work = in_codebooks(strong, np.ones(len(scene)), each, DEFAULT, 0)
        found.append(decibels(work.packed().gaussians(), shown))
        wanted = assign_slopes(work.harmonics, strong, each)
        off = work.colour.decode().detach().numpy() - wanted
        assert off.std() < 0.04 * wanted.std()  # 0.06 with entries for the colours as they were
    assert found[0] > found[1] + 0.1 and min(found[:2]) > max(found[2:]) + 5
