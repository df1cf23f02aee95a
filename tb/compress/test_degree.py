"""Compression to a given degree, and to models in steps."""

from dataclasses import replace

import pytest
import torch

from splatcore.golden.pipeline import render as golden_render
from splatcore.golden.reference import render as reference
from splatcore.model.compress import compress as compress_module
from splatcore.model.compress.checkpoint import ply_bytes
from splatcore.model.compress.compress import compress
from splatcore.model.compress.judge import decibels
from splatcore.model.compress.quantize import REFRESH
from splatcore.model.compress.steps import InSteps
from splatcore.model.gradients.differentiable import render
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.metric import psnr
from splatcore.spec.colour import COARSE, FINE, SECOND
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError
from splatcore.spec.preset import find_preset
from tb.helpers.compression_scene import RECIPE


@pytest.mark.parametrize(
    "degree, quality, layout", [(2, None, SECOND), (3, None, COARSE), (3, "faithful", FINE)]
)
def test_model_in_steps(scene, targets, checkpoints, monkeypatch, degree, quality, layout):
    """Distillation ends at the degree; the model keeps the ratio, equals the scene that fine-tuning
    rendered last, and the golden model draws it like the reference."""
    recipe = replace(RECIPE, degree=degree, quality=quality, target_ratio=6.0)
    works, right = [], InSteps.rendered
    monkeypatch.setattr(compress_module, "REFRESH", 1)
    monkeypatch.setattr(compress_module, "best_looking", lambda versions, targets: versions[-1])
    monkeypatch.setattr(InSteps, "rendered", lambda *a: works.append(a[0]) or right(*a))
    steps = list(compress(scene, targets, recipe, checkpoints))
    distilled = [step.sh_degree for step in steps if step.kind == "distill"]
    assert distilled == list(range(2, degree - 1, -1)) and len(works) == recipe.quantize_steps
    model = checkpoints.load(steps[-1])
    assert model.format.sh_degree == degree and not model.format.codebooks
    assert set(model.chunks["harmonics"]) == {layout}
    assert 6 <= ply_bytes(len(scene), 3) / steps[-1].bytes < 7
    camera, held = targets[0].camera, model.gaussians()
    arrays = (held.position, held.factor, held.opacity, held.sh)
    with torch.no_grad():
        found = render(*(torch.tensor(array, dtype=torch.float32) for array in arrays), camera)
        wanted = render(*right(works[-1], works[-1].tensors), camera)
    assert (found.image - wanted.image).abs().max() < 5e-4
    exact = reference(held, camera).pixels.astype(float)
    machine = golden_render(DEFAULT, model, camera).pixels.astype(float)
    assert psnr(machine / 255, exact / 255) > 45 and machine.max() > 100


def test_learning_under_the_numbers_of_a_scene_that_is_right(scene, targets, checkpoints):
    """Without pruning, fine-tuning recovers over 1 dB of the rounding loss: its learning rates are
    low enough not to drive a scene away from pictures that it already matches."""
    recipe = replace(RECIPE, schedule=(), degree=3, quantize_steps=REFRESH)
    model = checkpoints.load(list(compress(scene, targets, recipe, checkpoints))[-1])
    packed = pack(scene, DEFAULT, 3, quality="balanced")[0]
    found, before = (decibels(each.gaussians(), targets) for each in (model, packed))
    assert found > before + 1


def test_degree_above_that_of_the_scene_or_the_machine(scene, targets, checkpoints):
    """The message names the scene or preset and both degrees, before any work."""
    second = replace(scene.with_sh_degree(2), name="second.ply")
    for given, degree, config, message in (
        (second, 3, DEFAULT, "second.ply: --degree 3 is above its degree 2"),
        (second, 2, find_preset("PAPER"), "preset PAPER: --degree 2 is above its degree 1"),
    ):
        with pytest.raises(InputError, match=f"^{message}$"):
            list(compress(given, targets, replace(RECIPE, degree=degree), checkpoints, config))
    assert not checkpoints.folder.exists()
