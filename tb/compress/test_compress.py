"""Compression from a scene to a packed model: single steps, and whole runs on a generated scene."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch

from splatcore.golden.pipeline import render as golden_render
from splatcore.golden.reference import render as reference
from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.choice import decibels
from splatcore.model.compress.compress import compress
from splatcore.model.compress.prune import prune, sound
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.significance import significance
from splatcore.model.generate.generate import generated_camera
from splatcore.model.gradients import finetune as finetune_module
from splatcore.model.gradients import trainable
from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.gradients.finetune import (
    LAPS,
    Run,
    difference,
    finetune,
    optimise,
    views_in_turn,
)
from splatcore.model.gradients.trainable import optimizers, rendered, scene_of, tensors_of
from splatcore.sim.frame.metric import psnr
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.error import InputError
from splatcore.spec.scene import ARRAYS, Scene
from tb.helpers.compression_scene import RECIPE, SIZE, noted, nothing
from tb.helpers.refusal import refused

FIRST = replace(RECIPE, degree=1)


@pytest.fixture(scope="module")
def finished(scene, targets, tmp_path_factory):
    """Checkpoints of a complete compression."""
    folder = tmp_path_factory.mktemp("whole") / "steps"
    checkpoints = Checkpoints(folder, "key")
    assert tuple(compress(scene, targets, FIRST, checkpoints)) == checkpoints.steps
    return checkpoints


def test_steps(scene, finished):
    steps = finished.steps
    names = [step.name for step in steps]
    assert names[:5] == ["original", "distill 2", "distill 1", "prune 0.3", "prune 0.2"]
    assert names[-1] == "quantize" and set(names[5:-1]) <= {"distill 0"}
    assert [step.kind for step in steps[:4]] == ["original", "distill", "distill", "prune"]
    assert steps[0].bytes == ply_bytes(len(scene), 3)
    assert abs(steps[3].gaussians - 0.7 * len(scene)) < 0.02 * len(scene)
    assert [step.sh_degree for step in steps[:5]] == [3, 2, 1, 1, 1]
    assert steps[-1].bytes == len(finished.load(steps[-1]).image) < steps[0].bytes / 8
    assert all(np.isfinite(step.loss) for step in steps[1:])


def test_order_of_the_paper(scene, targets, checkpoints):
    """prune-first: pruning, then distilling harmonics."""
    recipe = replace(FIRST, order="prune-first")
    steps = list(islice(compress(scene, targets, recipe, checkpoints), 5))
    names = [step.name for step in steps]
    assert names == ["original", "prune 0.3", "prune 0.2", "distill 2", "distill 1"]
    assert [step.sh_degree for step in steps] == [3, 3, 3, 2, 1]


def test_the_machine_renders_it(finished):
    """The golden model draws the compressed model like the reference, at over 45 dB."""
    model = finished.load(finished.last)
    camera = generated_camera("garden").resized(*SIZE)
    exact = reference(model.gaussians(), camera).pixels.astype(float)
    for config in (DEFAULT, TINY):
        drawn = golden_render(config, model, camera).pixels.astype(float)
        assert psnr(drawn / 255, exact / 255) > 45
        assert drawn.max() > 100


def test_goes_on_where_it_stopped(scene, targets, finished, tmp_path):
    """Stopped after every step, a run ends with the same model as without stops."""
    for count, wanted in enumerate(finished.steps, 1):
        checkpoints = Checkpoints(tmp_path / "steps", "key")
        *_, step = islice(compress(scene, targets, FIRST, checkpoints), count)
        assert step.name == wanted.name and len(checkpoints.steps) == count
    first, second = (each.load(each.last).image for each in (finished, checkpoints))
    assert np.array_equal(first, second)
    assert tuple(compress(scene, targets, FIRST, checkpoints)) == checkpoints.steps


def test_another_seed_is_another_model(scene, targets, finished, checkpoints):
    *_, last = compress(scene, targets, replace(FIRST, seed=1), checkpoints)
    images = checkpoints.load(last).image, finished.load(finished.last).image
    assert not np.array_equal(*images)


def test_target_ratio(scene, targets, checkpoints, tmp_path):
    *_, step = compress(scene, targets, replace(RECIPE, target_ratio=15.0), checkpoints)
    assert 15 <= ply_bytes(len(scene), 3) / step.bytes < 20
    far, empty = replace(RECIPE, target_ratio=1e6), Checkpoints(tmp_path / "b", "")
    refused("--target-ratio: allows 0 bytes", list, compress(scene, targets, far, empty))


def test_a_ratio_that_packing_alone_gives(scene, targets, checkpoints):
    steps = compress(scene, targets, replace(RECIPE, target_ratio=1.5), checkpoints)
    assert not any(step.kind == "prune" for step in steps) and checkpoints.find("quantize")


def test_nan_in_the_loss(scene, targets, checkpoints, monkeypatch):
    """The run stops, names the step, and keeps the steps before it."""
    calls = []
    right = finetune_module.difference

    def wrong(*arguments):
        calls.append(1)
        return right(*arguments) * (float("nan") if len(calls) == RECIPE.steps + 3 else 1)

    monkeypatch.setattr(finetune_module, "difference", wrong)
    with pytest.raises(InputError, match=r"prune 0.2: the loss is nan at step 3 of 6.*steps"):
        list(compress(scene, targets, FIRST, checkpoints))
    assert [step.name for step in checkpoints.steps][-2:] == ["distill 1", "prune 0.3"]
    assert np.isfinite(checkpoints.load(checkpoints.last).position).all()
    monkeypatch.undo()
    *_, last = compress(scene, targets, FIRST, checkpoints)
    assert last.kind == "quantize"


def test_nothing_to_see(scene, targets, tmp_path):
    clear = replace(scene, opacity=np.full(len(scene), 1e-3), name="clear.ply")
    away = replace(scene, position=scene.position + 1e4, name="away.ply")
    for name, learned, message in (
        (clear, targets, "clear.ply: no Gaussian can be seen"),
        (away, targets, "away.ply: no view shows a Gaussian"),
        (scene, (), "no picture to learn from"),
    ):
        refused(message, list, compress(name, learned, RECIPE, Checkpoints(tmp_path / message, "")))


def test_significance(scene, cameras):
    """Almost none for a hidden Gaussian, none behind the camera; views add up."""
    found = significance(scene, cameras)
    assert found.shape == (len(scene),) and (found >= 0).all() and found.any()
    parts = [significance(scene, [camera]) for camera in cameras]
    assert np.allclose(sum(parts), found, rtol=1e-5)
    camera = generated_camera("garden").resized(*SIZE)
    forward = camera.rotation[2]
    place = camera.position + np.outer([2.0, 3.0, -3.0], forward)
    size = np.repeat([[1.0], [0.1], [1.0]], 3, axis=1)
    stack = Scene(place, size, np.eye(4)[[0, 0, 0]], [0.999] * 3, np.zeros((3, 1, 3)))
    front, hidden, behind = significance(stack, [camera])
    (seen,) = significance(stack[[1]], [camera])
    assert 0 < hidden < 0.03 * seen < front and behind == 0
    volume = scene.scale.prod(axis=1)
    term = np.minimum(volume / np.percentile(volume, 90), 1) ** 0.1
    assert np.allclose(sum(blending_weights(scene.gaussians(), cameras)) * term, found)


def test_merging_loses_less_than_dropping(scene, targets, cameras):
    weight = significance(scene, cameras)
    order = np.argsort(weight, kind="stable")
    dropped = scene[np.sort(order[round(0.8 * len(scene)) :])]
    assert decibels(prune(scene, weight, 0.8), targets) > decibels(dropped, targets) + 0.3


def test_views_in_turn():
    views = views_in_turn(list(range(5)), 3)
    first = [next(views) for _ in range(10)]
    assert sorted(first[:5]) == sorted(first[5:]) == list(range(5))
    assert first[:5] != first[5:] and sorted(first[:5]) != first[:5]
    again = views_in_turn(list(range(5)), 3)
    assert [next(again) for _ in range(10)] == first


def test_all_views_before_one_comes_again():
    """Each lap shows every view once, also after the laps of one order."""
    views = views_in_turn(list(range(500)), 0)
    laps = [[next(views) for _ in range(500)] for _ in range(LAPS + 1)]
    assert all(sorted(lap) == list(range(500)) for lap in laps)
    assert len({tuple(lap) for lap in laps}) == LAPS + 1


def test_every_view_is_learned_from(scene, targets, monkeypatch):
    calls = noted(monkeypatch, finetune_module, "render")
    tensors = tensors_of(scene)
    finetune(tensors, optimizers(tensors, 1.0), targets, 0, Run("test", len(targets), 0.3, nothing))
    seen = [given[-1] for given in calls]
    assert {*seen} == {target.camera for target in targets} and len(seen) == len(targets)


def test_difference_is_that_of_the_clipped_picture():
    picture = torch.tensor([[-0.5, 0.5, 1.5]], requires_grad=True)
    loss = difference(picture, torch.tensor([[0.0, 0.2, 1.0]]))
    loss.backward()
    assert float(loss.detach()) == pytest.approx((0.3**2 / 3) ** 0.5)
    assert picture.grad.tolist()[0][::2] == [0, 0]


def test_a_perfect_picture_moves_nothing():
    picture = torch.full((2, 3), 0.5, requires_grad=True)
    difference(picture, picture.detach()).backward()
    assert not picture.grad.any()


def test_finetuning_helps(scene, targets):
    tensors = tensors_of(replace(scene, sh=scene.sh * 0.9))
    before = decibels(scene_of(tensors), targets)
    finetune(tensors, optimizers(tensors, 1.0), targets, 0, Run("test", 30, 0.3, nothing))
    assert decibels(scene_of(tensors), targets) > before + 1


def test_learning_rates_rise_then_fall():
    """From a tenth to the full rate in ten steps, then down to the share `left`."""
    for left in (0.3, 0.02):
        leaves = {name: torch.zeros(1, requires_grad=True) for name in ("means", "scales")}
        adams = {name: torch.optim.Adam([leaf], lr=2.0) for name, leaf in leaves.items()}
        seen = []

        def progress(*_, adams=adams, seen=seen):
            seen.append([adam.param_groups[0]["lr"] for adam in adams.values()])

        def loss(_, leaves=leaves) -> torch.Tensor:
            return sum(leaf.sum() for leaf in leaves.values())

        optimise(adams, Run("test", 200, left, progress), loss)
        rates = np.array(seen)
        assert np.allclose(rates[0], 0.2) and np.allclose(rates[9], 2, rtol=0.25)
        assert (np.diff(rates[:10], axis=0) > 0).all() and (np.diff(rates[10:], axis=0) < 0).all()
        assert np.allclose(rates[-1], 2 * left, rtol=0.03)


@pytest.mark.parametrize(("degree", "wanted"), [(1, (0.3, 0.3)), (2, (0.03, 0.2))])
def test_learning_rates_of_the_format(scene, targets, checkpoints, monkeypatch, degree, wanted):
    """In codebooks, quantisation starts at the rate where fine-tuning ends. In steps, fine-tuning
    decays almost to 0 and quantisation starts again at a fifth."""
    seen, learn = {}, finetune_module.optimise

    def rates(optimizers, run, loss_of):
        first = {name: adam.param_groups[0]["lr"] for name, adam in optimizers.items()}
        seen[run.phase] = first, run.left
        return learn(optimizers, run, loss_of)

    monkeypatch.setattr(finetune_module, "optimise", rates)
    recipe = replace(RECIPE, degree=degree, schedule=(0.3,), distill_steps=0)
    list(compress(scene, targets, recipe, checkpoints))
    (before, left), (after, last) = seen["prune 0.3"], seen["quantize"]
    for name, rate in before.items():
        changed = 0.2 if name == "means" else 1e-6  # the Gaussians' size has changed a little
        assert after[name] == pytest.approx(rate * wanted[1], rel=changed), name
    assert (left, last) == (wanted[0], 0.02)


def test_positions_learn_in_sizes_of_the_gaussians(scene, targets, checkpoints, monkeypatch):
    """The unit of the positions' rate is the median of the Gaussians' middle scales."""
    units, make = [], trainable.optimizers

    def measured(tensors, unit, *others):
        units.append((unit, np.median(np.sort(scene_of(tensors).scale, axis=1)[:, 1])))
        return make(tensors, unit, *others)

    monkeypatch.setattr(trainable, "optimizers", measured)
    list(compress(scene, targets, FIRST, checkpoints))
    assert len(units) == 5, "two degrees, two prunings, quantisation"
    for unit, middle in units:
        assert unit == pytest.approx(middle, rel=0.01)


def test_rendered_parameters(scene):
    """A scene converted to tensors and back is the same scene, to float32."""
    kept = sound(scene)
    back = scene_of(tensors_of(kept))
    for name in ARRAYS:
        assert np.allclose(getattr(back, name), getattr(kept, name), rtol=2e-5, atol=1e-7), name
    factor = rendered(tensors_of(kept))[1].detach().numpy()
    assert np.allclose(factor, kept.gaussians().factor, atol=1e-5)


@pytest.mark.parametrize(
    "change, option",
    (
        ({"schedule": (0.4, 1.0)}, "--schedule"), ({"steps": -1}, "--steps"),
        ({"target_ratio": 0.5}, "--target-ratio"), ({"max_drop": 0.0}, "--max-drop"),
        ({"target_bytes": 0}, "--target-bytes"), ({"target_psnr": -1.0}, "--target-psnr"),
        ({"target_fps": 0.0}, "--target-fps"),
        ({"target_fps": 9.0, "target_psnr": 9.0}, "--target-psnr, --target-fps"),
        ({"degree": 4}, "--degree"), ({"quality": "faithful"}, "--quality"),
        ({"degree": 1, "quality": "balanced"}, "--quality"),
        ({"degree": 3, "quality": "compact"}, "--quality"), ({"rate": 0.0}, "--rate"),
        ({"order": "both"}, "--order"),
        ({"target_ratio": 5.0, "max_drop": 1.0}, "--target-ratio, --max-drop"),
    ),
)  # fmt: skip
def test_recipes_that_cannot_be(change, option):
    refused(f"^{option}: ", Recipe, **change)
