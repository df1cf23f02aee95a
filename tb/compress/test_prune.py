"""Pruning: which Gaussians are removed, and how the remaining ones absorb them."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.compress import prune as pruning
from splatcore.model.compress.prune import cheapest_pairs, prune, sound
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import ALPHA_MAX
from splatcore.spec.memory import model_format, step_format
from splatcore.spec.scene import ARRAYS
from tb.helpers.scenes import random_scene


def test_broken_gaussians_are_left_out(garden):
    position = garden.position.copy()
    position[3, 1] = np.nan
    opacity = garden.opacity.copy()
    opacity[5] = 0.0
    kept = sound(replace(garden, position=position, opacity=opacity))
    assert len(kept) == len(sound(garden)) - 2


def test_prune(garden):
    """The share is exact; Gaussians that absorb no other keep their values and order."""
    weight = np.random.default_rng(0).random(len(garden)) + 0.1
    kept = prune(garden, weight, 0.25)
    assert len(kept) == len(garden) - round(0.25 * len(garden))
    place = {tuple(position): n for n, position in enumerate(garden.position)}
    unchanged = [n for n, position in enumerate(kept.position) if tuple(position) in place]
    origin = [place[tuple(kept.position[n])] for n in unchanged]
    assert 0.5 * len(kept) < len(unchanged) < len(kept) and origin == sorted(origin)
    for name in ("scale", "quaternion", "opacity", "sh"):
        assert np.array_equal(getattr(kept, name)[unchanged], getattr(garden, name)[origin]), name
    assert np.array_equal(prune(garden, weight, 0.25).position, kept.position)


def test_the_cheapest_pairs():
    """Distance, weight, colour and size each decide alone which pair is merged first."""
    six = random_scene(6, 0)
    place = np.zeros((6, 3))
    place[:, 0] = (0, 1, 10, 10.5, 20, 21)
    even = replace(six, position=place, scale=np.ones((6, 3)), sh=np.zeros((6, 1, 3)))
    found = zip(*cheapest_pairs(even, np.ones(6), 3), strict=True)
    pairs = [sorted(map(int, pair)) for pair in found]
    assert pairs[0] == [2, 3] and sorted(pairs) == [[0, 1], [2, 3], [4, 5]]
    light = np.array([1, 1, 1, 1, 0.01, 1])
    first, second = cheapest_pairs(even, light, 1)
    assert (first, second) == (5, 4)  # the heavier one stays
    dyed = even.sh.copy()
    dyed[[2, 4]] = 3.0
    first, second = cheapest_pairs(replace(even, sh=dyed), np.ones(6), 1)
    assert sorted((int(first[0]), int(second[0]))) == [0, 1]
    large = replace(even, scale=np.array([1, 1, 1, 1, 9, 9])[:, None] * np.ones((6, 3)))
    assert sorted(map(int, np.concatenate(cheapest_pairs(large, np.ones(6), 1)))) == [4, 5]


def test_pairs_share_no_member(garden):
    first, second = cheapest_pairs(garden, np.ones(len(garden)), len(garden) // 2)
    members = np.concatenate([first, second])
    assert len(np.unique(members)) == len(members) > len(garden) // 3


def test_one_of_four_gives_what_four_gave():
    """Merging four equal Gaussians one by one adds up opacities, and so must add up weights."""
    four = random_scene(4, 0)[[0, 0, 0, 0]]
    one = prune(replace(four, opacity=np.full(4, 0.1)), np.ones(4), 0.75)
    assert len(one) == 1 and np.allclose(one.opacity, 0.4)
    assert np.allclose(np.sort(one.scale), np.sort(four.scale[:1]))


def test_unseen_gaussians_are_simply_removed(garden):
    """Gaussians of weight 0 go first, and change no other."""
    weight = np.where(np.arange(len(garden)) < 200, 0.0, 1.0)
    kept = prune(garden, weight, 200 / len(garden))
    for name in ARRAYS:
        assert np.array_equal(getattr(kept, name), getattr(garden, name)[200:]), name


def test_merged_moments():
    """Mean, covariance and colour of a merged pair against samples; opacity × area is kept."""
    pair = random_scene(2, 1, seed=3)
    weight = np.array([3.0, 1.0])
    one = pruning.merge(pair, weight, np.zeros(2, int), 1)
    share = weight / weight.sum()
    rng = np.random.default_rng(0)
    factor = pair.gaussians().factor
    drawn = [pair.position[k] + rng.standard_normal((400_000, 3)) @ factor[k].T for k in range(2)]
    mean = share @ np.array([each.mean(axis=0) for each in drawn])
    away = [each - mean for each in drawn]
    spread = sum(share[k] * away[k].T @ away[k] / len(away[k]) for k in range(2))
    assert np.allclose(one.position[0], mean, atol=0.01)
    found = one.gaussians().factor[0] @ one.gaussians().factor[0].T
    assert np.allclose(found, spread, atol=0.01 * np.abs(spread).max())
    assert np.allclose(one.sh[0], share[0] * pair.sh[0] + share[1] * pair.sh[1])
    covered = [each.opacity[0] * np.sort(each.scale[0])[1:].prod() for each in (one, pair)]
    assert np.isclose(covered[0], covered[1] * 4 / 3) or one.opacity[0] == ALPHA_MAX


def test_scaled_schedule():
    rates = pruning.scaled_schedule((0.4, 0.4, 0.4, 0.2), 1000, 100)
    assert np.isclose(np.prod(1 - np.array(rates)), 0.1)
    assert rates[0] == rates[1] == rates[2] > rates[3]
    assert pruning.scaled_schedule((0.4,), 100, 100) == ()
    assert np.isclose(pruning.scaled_schedule((), 100, 25)[0], 0.75)


def test_count_in():
    """The largest count that fits into the bytes, for models in codebooks and in steps."""
    format = model_format(DEFAULT, 1)
    count = pruning.count_in(200_000, format)
    assert format.layout(count).end <= 200_000 < format.layout(count + 3).end
    steps = step_format(DEFAULT, 3)
    count = pruning.count_in(200_000, steps, beats=2)
    sizes = [steps.layout(n, 2 * n).end for n in (count, count + 3)]
    assert sizes[0] <= 200_000 < sizes[1]
    assert pruning.count_in(10, format) == 0


def test_significances_of_what_stays():
    """A merged Gaussian weighs as much as the Gaussians in it."""
    scene = random_scene(60, 0)
    weight = np.random.default_rng(0).uniform(0.1, 1, 60)
    left, found = pruning.merged(scene, weight, 0.5)
    assert len(left) == len(found) == 30 and found.sum() == pytest.approx(weight.sum())
