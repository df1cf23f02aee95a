"""Fine-tuning on the packed model's numbers: it renders the values that the machine reads."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from splatcore.model.compress import codebooks
from splatcore.model.compress.quantize import round_fixed, round_float
from splatcore.model.compress.significance import Directions
from splatcore.model.compress.steps import InSteps
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.finetune import Run, as_tensor, difference, finetune
from splatcore.model.gradients.trainable import RATES, REFINING, optimizers, scene_of, tensors_of
from splatcore.model.pack.quality import COMPACT, INDEXED
from splatcore.model.pack.stored import stored_scene
from splatcore.spec.colour import COARSE, FINE
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.memory import FACTOR, OPACITY
from splatcore.spec.number import Float
from tb.helpers.compression_scene import nothing


def in_codebooks(scene, weight, config, seed, quality=COMPACT):
    """Codebooks for views from all directions."""
    count = len(scene)
    seen = Directions(np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3)))
    return codebooks.in_codebooks(scene, weight, seen, config, seed, quality)


def compared(work):
    """Check rendered values against the decoded packed model, per Gaussian; return both
    harmonics."""
    order = stored_scene(scene_of(work.tensors), work.format).index
    rendered = [tensor.detach().numpy() for tensor in work.rendered(work.tensors)]
    position, factor, opacity, sh = (array[order] for array in rendered)
    packed = work.packed().gaussians()
    assert len(packed) == len(order)
    near = {"rtol": 2e-6, "atol": 1e-6}
    assert np.allclose(packed.position, position, **near)
    off = np.abs(packed.factor - factor)
    axis = np.abs(packed.factor).max(axis=(1, 2))[:, None, None]
    step = 2.0**-FACTOR.fraction * np.abs(packed.factor)
    assert (off <= 1.01 * step + 1e-5 * axis).all()  # float32 and float64 may round to neighbours,
    assert (off <= 1e-6 * axis).mean() > 0.98  # but seldom do
    assert np.allclose(packed.opacity, opacity, rtol=1e-5)
    gone = np.setdiff1d(np.arange(len(rendered[2])), order)
    assert not rendered[2][gone].any()
    return packed.sh, sh


@torch.no_grad()
def error(parameters, targets) -> float:
    """Mean over views of the root mean squared error of pictures rendered from `parameters`."""
    pictures = [render(*parameters, target.camera).image for target in targets]
    off = [
        float(difference(picture, as_tensor(target.image, picture)))
        for picture, target in zip(pictures, targets, strict=True)
    ]
    return float(np.mean(off))


@pytest.mark.parametrize("quality", INDEXED)
@pytest.mark.parametrize("degree", (0, 1))
@pytest.mark.parametrize("config", (DEFAULT, TINY), ids=lambda config: config.name)
def test_quantised_is_what_the_machine_reads(garden, degree, config, quality):
    """In codebooks: rendered values equal the decoded packed model."""
    work = in_codebooks(garden.with_sh_degree(degree), np.ones(len(garden)), config, 0, quality)
    with torch.no_grad():  # off the entries that k-means gave
        for entries in work.colour.entries:
            entries += 0.003
    assert np.allclose(*compared(work), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("quality", ("balanced", "faithful", "layouts"))
@pytest.mark.parametrize("degree", (0, 1, 2, 3))
def test_steps_are_what_the_machine_reads(scene, degree, quality):
    """In steps: the same, after parameters moved and some Gaussians became transparent."""
    chosen = np.array([FINE, 0, COARSE]) if quality == "layouts" else quality
    work = InSteps(tensors_of(scene.with_sh_degree(degree)), DEFAULT, chosen)
    with torch.no_grad():
        for tensor in work.tensors.values():
            tensor *= 1.01
        work.tensors["opacities"][::50] = -9
    work.refresh()
    packed, rendered = compared(work)
    assert packed.any(axis=(0, 2)).all(), "every coefficient is used"
    assert np.allclose(packed, rendered, rtol=1e-6, atol=1e-7)
    moved = scene_of(work.tensors)
    off = np.abs(packed - stored_scene(moved, work.format).scene.sh).max(axis=(0, 2))
    assert (off > 1e-4).all(), "and is rounded"


@pytest.mark.parametrize("format", (FACTOR, Float(5, 10, signed=True), Float(4, 3)))
def test_round_float(format):
    rng = np.random.default_rng(0)
    value = rng.standard_normal(4000) * 2.0 ** rng.integers(-30, 30, 4000)
    value = np.concatenate([value, [0.0, format.max, 2 * format.max, format.min_subnormal / 2]])
    value = value.astype(np.float32).astype(np.float64)
    if format.overflow == "infinity":
        value = value[np.abs(value) <= format.max]
    found = round_float(torch.tensor(value), format)
    assert np.array_equal(found.numpy(), format.round(value))


def test_round_fixed_and_straight_through():
    value = np.concatenate([np.random.default_rng(0).uniform(-1, 10, 4000), [0.0, 7.99, 8.5]])
    leaf = torch.tensor(value, requires_grad=True)
    found = round_fixed(leaf, OPACITY)
    assert np.array_equal(found.detach().numpy(), OPACITY.round(value))
    found.sum().backward()
    assert np.array_equal(leaf.grad.numpy(), np.ones(len(value)))


def test_codebooks_learn(scene, targets):
    """Fine-tuning moves the entries, which stay on their grid."""
    work = in_codebooks(scene.with_sh_degree(1), np.ones(len(scene)), DEFAULT, 0)
    before = [entries.copy() for entries in work.colour.codebook().entries]
    wrong = error(work.rendered(work.tensors), targets)
    leaves, rates = work.leaves()
    adams = optimizers(leaves, 1.0, RATES | rates)
    finetune(work.tensors, adams, targets, 0, Run("x", 40, 0.3, nothing), work.rendered)
    after = work.colour.codebook()
    assert any((a != b).any() for a, b in zip(before, after.entries, strict=True))
    assert all(np.array_equal(entries, np.rint(entries)) for entries in after.entries)
    assert error(work.rendered(work.tensors), targets) < 0.95 * wrong


@pytest.mark.parametrize("quality", INDEXED)
def test_gaussians_take_nearer_entries(scene, targets, quality):
    """With fixed entries, wrong harmonics improve by choosing other entries."""
    right = scene.with_sh_degree(1)
    sh = right.sh.copy()
    sh[:, 0] += np.random.default_rng(0).normal(0, 0.5, sh[:, 0].shape)
    wrong = replace(right, sh=sh)
    work = in_codebooks(wrong, np.ones(len(scene)), DEFAULT, 0, quality)
    given = [index.clone() for index in work.colour.index]
    before = error(work.rendered(work.tensors), targets)
    leaves, rates = work.leaves()
    harmonics = {name: leaves[name] for name in ("sh0", "shN")}
    adams = optimizers(harmonics, 1.0, REFINING | rates)
    for _ in range(3):
        finetune(work.tensors, adams, targets, 0, Run("x", 20, 0.3, nothing), work.rendered)
        work.refresh()
    assert error(work.rendered(work.tensors), targets) < 0.96 * before
    assert all((a != b).any() for a, b in zip(given, work.colour.index, strict=True))
    assert np.allclose(*compared(work), rtol=1e-4, atol=1e-5)


def test_harmonics_in_steps_learn(scene, targets):
    """Gradients pass through the rounding: wrong colours improve, and stay multiples of steps."""
    wrong = replace(scene.with_sh_degree(2), sh=0.9 * scene.with_sh_degree(2).sh)
    work = InSteps(tensors_of(wrong), DEFAULT, "balanced")
    before = error(work.rendered(work.tensors), targets)
    leaves, rates = work.leaves()
    harmonics = {name: leaves[name] for name in ("sh0", "shN")}
    adams = optimizers(harmonics, 1.0, REFINING | rates)
    finetune(work.tensors, adams, targets, 0, Run("x", 30, 0.3, nothing), work.rendered)
    assert error(work.rendered(work.tensors), targets) < 0.7 * before
    work.refresh()
    assert np.allclose(*compared(work), rtol=1e-6, atol=1e-7)


def test_weighted_codebooks(garden):
    """Gaussians of larger weight are nearer to their entries."""
    weight = np.where(np.arange(len(garden)) < 100, 1e4, 1.0)
    many = replace(garden, sh=np.random.default_rng(0).normal(0, 1, garden.sh.shape))
    even = in_codebooks(many.with_sh_degree(1), np.ones(len(garden)), DEFAULT, 0)
    uneven = in_codebooks(many.with_sh_degree(1), weight, DEFAULT, 0)
    colour = torch.tensor(many.sh[:100, 0] * 0.28209479 + 0.5)

    def error(work):
        return float(((work.colour.decode()[:100].detach() - colour) ** 2).mean())

    assert error(uneven) < error(even)
