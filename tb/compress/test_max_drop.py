"""Compression with `--max-drop`: the allowed loss holds on views that it does not learn from."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.model.compress import compress as compress_module
from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.model.compress.compress import Compression, compress, decibels
from splatcore.model.compress.significance import significance
from splatcore.model.formats.photographs import Target
from splatcore.spec.config import DEFAULT
from tb.helpers.compression_scene import RECIPE, noted, nothing
from tb.helpers.refusal import refused


@pytest.fixture
def noisy(targets):
    """Photographs: pictures of the scene with noise that it cannot reproduce."""
    rng = np.random.default_rng(0)
    photographs = []
    for each in targets:
        image = np.clip(each.image + rng.normal(0, 12, each.image.shape), 0, 255)
        photographs.append(Target(each.camera, image.astype(np.uint8), each.name))
    return photographs


def test_max_drop(scene, targets, noisy, checkpoints, tmp_path):
    """The loss on held-out views keeps to the limit, with pruning; an impossible limit is
    refused."""
    recipe = replace(RECIPE, max_drop=3.0, steps=20, quantize_steps=20)
    *_, step = compress(scene, noisy, recipe, checkpoints)
    aside = noisy[:: compress_module.ASIDE]
    lost = decibels(scene, aside) - decibels(checkpoints.load(step).gaussians(), aside)
    assert lost <= 3.0
    assert any(each.kind == "prune" for each in checkpoints.steps)
    strict, empty = replace(recipe, max_drop=1e-6), Checkpoints(tmp_path / "b", "")
    refused(r"--max-drop: 1e-06 dB cannot be kept", list, compress(scene, targets, strict, empty))


def test_pruning_ends_where_rates_remove_nothing(scene, noisy, checkpoints):
    """Under a limit that never binds, pruning ends when the smallest rate removes no Gaussian."""
    recipe = replace(RECIPE, degree=1, max_drop=60.0, steps=1, quantize_steps=1, distill_steps=0)
    assert min(step.gaussians for step in compress(scene, noisy, recipe, checkpoints)) < 5


def test_held_out_views_are_not_learned_from(scene, targets, checkpoints, monkeypatch):
    """No fine-tuning sees every seventh view, the first one included."""
    calls = noted(monkeypatch, compress_module, "finetune")
    steps = list(compress(scene, targets, replace(RECIPE, degree=1, max_drop=30.0), checkpoints))
    seen = {target.name for _, _, learned, *_ in calls for target in learned}
    assert seen == {target.name for k, target in enumerate(targets) if k not in (0, 7)}
    kinds = [step.kind for step in steps]
    assert kinds[:4] == ["original", "distill", "distill", "prune"]


def test_significance_is_remembered(scene, targets, cameras, monkeypatch):
    """The last scene's significance is cached; it covers at most WEIGHED training views."""
    work = Compression(targets, RECIPE, None, DEFAULT, nothing)
    wanted = significance(scene, cameras)
    for _ in range(2):
        assert np.allclose(work.weights(scene, "x"), wanted)
    monkeypatch.setattr(compress_module, "WEIGHED", 3)
    other = scene[:300]
    some = significance(other, cameras[::3])
    assert np.allclose(work.weights(other, "x"), some)
    assert len(work.weights(other, "x")) == 300
