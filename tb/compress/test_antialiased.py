"""Compressing and training antialiased scenes: each step renders compensated and keeps the mark."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render as reference
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.compress.compress import compress
from splatcore.model.compress.judge import decibels
from splatcore.model.compress.prune import merge, prune
from splatcore.model.compress.significance import significance
from splatcore.model.compress.teacher import pictures, teacher_targets
from splatcore.model.compress.train import TRAINED, initial_scene, train
from splatcore.model.gradients import drawn
from splatcore.model.gradients.trainable import scene_of, tensors_of
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.error import InputError
from tb.helpers.compression_scene import RECIPE, SIZE, nothing

MARK = "by its file"


@pytest.fixture(scope="module")
def marked(scene):
    """The scene with the mark, mostly smaller than a pixel: uncompensated it renders at 23 dB."""
    return replace(scene, scale=0.3 * scene.scale, name="marked", antialiased=True, mark=MARK)


@pytest.fixture
def compensated(monkeypatch):
    """One flag per rendered picture: whether its opacities were compensated."""
    flags, right = [], drawn.Drawn.__init__

    def recorded(self, arrays, camera, antialiased):
        flags.append(antialiased)
        right(self, arrays, camera, antialiased)

    monkeypatch.setattr(drawn.Drawn, "__init__", recorded)
    return flags


def test_own_pictures_are_those_of_the_reference(marked, cameras):
    shown = pictures(marked, cameras[:2])
    for target in shown:
        exact = reference(marked.gaussians(), target.camera).pixels
        assert np.abs(target.image - exact.astype(int)).max() <= 1
    assert decibels(marked, shown) > 50
    assert decibels(replace(marked, antialiased=False), shown) < 30


def test_weights_are_those_of_compensated_splats(marked, cameras):
    """Gaussians that compensation makes invisible weigh nothing, and are pruned first."""
    small = marked.scale.copy()
    small[:50] *= 1e-3
    dust = replace(marked, scale=small)
    found = significance(dust, cameras)
    assert not found[:50].any() and found[50:].any()
    assert significance(replace(dust, antialiased=False), cameras)[:50].any()
    left = prune(dust, found, 50 / len(dust))
    assert not np.isin(left.position, dust.position[:50]).any()
    one = merge(marked[:4], np.ones(4), np.zeros(4, int), 1)
    for kept in (left, one):
        assert (kept.antialiased, kept.mark, kept.name) == (True, MARK, "marked")


@pytest.mark.parametrize("degree, order", [(1, "distill-first"), (2, "prune-first")])
def test_compression(marked, checkpoints, compensated, degree, order):
    """In codebooks and in steps: every picture on the way to the model is compensated."""
    targets = teacher_targets(marked, 6, SIZE, 0)
    recipe = replace(RECIPE, degree=degree, order=order)
    steps = list(compress(marked, targets, recipe, checkpoints))
    assert {step.kind for step in steps} == {"original", "prune", "distill", "quantize"}
    for step in steps[:-1]:
        scene = checkpoints.load(step)
        assert (scene.antialiased, scene.mark, scene.name) == (True, MARK, "marked"), step.name
    model = checkpoints.load(steps[-1])
    assert model.antialiased and model.gaussians().antialiased
    assert len(compensated) > 30 and all(compensated)
    found = decibels(model.gaussians(), targets)
    assert found > decibels(replace(model.gaussians(), antialiased=False), targets) + 3


def test_compression_of_a_scene_without_the_mark(scene, targets, checkpoints, compensated):
    *steps, last = compress(scene, targets, replace(RECIPE, degree=1), checkpoints)
    assert not checkpoints.load(last).antialiased and not checkpoints.load(steps[0]).antialiased
    assert not any(compensated)


def test_tensors_know_no_mark(marked):
    """The mark comes from the scene given to `scene_of`, or is absent."""
    back = scene_of(tensors_of(marked), marked)
    assert (back.antialiased, back.mark, back.name) == (True, MARK, "marked")
    assert not scene_of(tensors_of(marked)).antialiased


def test_training(marked, compensated, tmp_path):
    """Every picture is compensated, and the scene is marked."""
    views = surrounding_views(marked.gaussians(), 3, 48, 32)
    photographs = list(pictures(marked, views))
    colour = np.clip(marked.sh[:, 0] * SH_C0 + 0.5, 0, 1) * 255
    points = marked.position[::2], colour[::2].astype(np.uint8)
    whole = train(photographs, points, 4, 0, tmp_path / "a", nothing, True)
    assert (whole.antialiased, whole.mark) == (True, TRAINED)
    assert len(compensated) > 4 and all(compensated)
    assert decibels(whole, photographs) > decibels(initial_scene(*points), photographs)
    assert (whole.opacity >= ALPHA_MIN).all()


def test_state_of_training_of_the_other_kind(marked, tmp_path, monkeypatch):
    """A state of antialiased training is refused by training without it."""
    monkeypatch.setattr("splatcore.model.compress.train.KEEP_EVERY", 2)
    photographs = list(pictures(marked, surrounding_views(marked.gaussians(), 2, 32, 24)))
    points = marked.position[::9], np.full((len(marked.position[::9]), 3), 128, np.uint8)
    train(photographs, points, 2, 0, tmp_path, nothing, True)
    with pytest.raises(
        InputError, match=r"training run \(78 points, 2 steps, seed 0, antialiased\)"
    ):
        train(photographs, points, 2, 0, tmp_path, nothing)
