"""Pruning: which Gaussians go, and what those that stay take in."""

from dataclasses import replace

import numpy as np
import pytest

from model.checkpoint import ply_bytes
from model.generate import generate
from model.prune import count_for_ratio, merge, original_bytes, prune, scaled_schedule, sound
from spec.config import DEFAULT
from spec.convention import ALPHA_MAX
from spec.memory import model_format
from spec.scene import Scene
from tb.scenes import random_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return generate("garden", 700)


def test_broken_gaussians_are_left_out(scene):
    position = scene.position.copy()
    position[3, 1] = np.nan
    opacity = scene.opacity.copy()
    opacity[5] = 0.0
    kept = sound(replace(scene, position=position, opacity=opacity))
    assert len(kept) == len(sound(scene)) - 2


def test_prune(scene):
    """The least significant go; those that take nothing in stay as they are, in their order."""
    weight = np.random.default_rng(0).random(len(scene)) + 0.1
    kept = prune(scene, weight, 0.25)
    gone = round(0.25 * len(scene))
    assert len(kept) == len(scene) - gone
    chosen = np.sort(np.argsort(weight)[gone:])
    same = (kept.position == scene.position[chosen]).all(axis=1)
    assert 0.5 < same.mean() < 1
    assert np.array_equal(kept.scale[same], scene.scale[chosen][same])
    assert (kept.scale[~same].max(axis=1) > 0).all()
    near = np.abs(kept.position - scene.position[chosen]).max(axis=1)
    assert np.median(near[~same]) < 0.3


def test_what_nobody_sees_leaves_nothing(scene):
    weight = np.where(np.arange(len(scene)) < 200, 0.0, 1.0)
    kept = prune(scene, weight, 200 / len(scene))
    assert np.array_equal(kept.position, scene.position[200:])
    assert np.array_equal(kept.sh, scene.sh[200:])


def test_merged_moments():
    """Against means over samples: mean, covariance, colour; and opacity times area of a pair."""
    pair = random_scene(2, 1, seed=3)
    weight = np.array([3.0, 1.0])
    one = merge(pair, weight, np.zeros(2, int), 1)
    share = weight / weight.sum()
    rng = np.random.default_rng(0)
    factor = pair.gaussians().factor
    drawn = [pair.position[k] + rng.standard_normal((400_000, 3)) @ factor[k].T for k in range(2)]
    mean = share @ np.array([each.mean(axis=0) for each in drawn])
    spread = sum(
        share[k] * (drawn[k] - mean).T @ (drawn[k] - mean) / len(drawn[k]) for k in range(2)
    )
    assert np.allclose(one.position[0], mean, atol=0.01)
    found = one.gaussians().factor[0] @ one.gaussians().factor[0].T
    assert np.allclose(found, spread, atol=0.01 * np.abs(spread).max())
    assert np.allclose(one.sh[0], share[0] * pair.sh[0] + share[1] * pair.sh[1])
    covered = [each.opacity[0] * np.sort(each.scale[0])[1:].prod() for each in (one, pair)]
    assert np.isclose(covered[0], covered[1] * 4 / 3) or one.opacity[0] == ALPHA_MAX


def test_scaled_schedule():
    rates = scaled_schedule((0.4, 0.4, 0.4, 0.2), 1000, 100)
    assert np.isclose(np.prod(1 - np.array(rates)), 0.1)
    assert rates[0] == rates[1] == rates[2] > rates[3]
    assert scaled_schedule((0.4,), 100, 100) == ()
    assert np.isclose(scaled_schedule((), 100, 25)[0], 0.75)


def test_count_for_ratio(scene):
    format = model_format(DEFAULT, 1)
    count = count_for_ratio(10_000_000, 50, format)
    assert format.layout(count).end <= 200_000 < format.layout(count + 3).end
    assert original_bytes(scene) == ply_bytes(len(scene), scene.sh_degree)
