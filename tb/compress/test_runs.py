"""Whole compressions: interrupted ones end with the same bits, `--max-drop` holds on views that are
not learned from, and every picture of an antialiased scene is compensated."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from splatcore.golden.reference import render as reference
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.compress import compress as compress_module
from splatcore.model.compress.checkpoint import Checkpoints
from splatcore.model.compress.codebooks import in_codebooks
from splatcore.model.compress.compress import Compression, compress
from splatcore.model.compress.judge import decibels
from splatcore.model.compress.prune import merge, prune
from splatcore.model.compress.significance import Directions, significance
from splatcore.model.compress.steps import InSteps
from splatcore.model.compress.teacher import pictures, teacher_targets
from splatcore.model.compress.train import TRAINED, initial_scene, train
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients import drawn
from splatcore.model.gradients import finetune as finetune_module
from splatcore.model.gradients.finetune import Unfinished
from splatcore.model.gradients.trainable import refining, scene_of, tensors_of
from splatcore.spec.colour import SH_C0
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import ALPHA_MIN
from tb.helpers.compression_scene import RECIPE, SIZE, noted, nothing
from tb.helpers.refusal import refused

STOPS = {"distill 2": 3, "distill 1": 3, "prune 0.3": 5, "prune 0.2": 5, "quantize": 5}
"""Phase → step after which the test stops it, once."""


class Stop(Exception):
    pass


@pytest.fixture
def often(monkeypatch):
    """Save a state every two steps; refresh codebooks and steps every three."""
    monkeypatch.setattr(finetune_module, "KEEP_EVERY", 2)
    monkeypatch.setattr(compress_module, "REFRESH", 3)


@pytest.mark.usefixtures("often")
@pytest.mark.parametrize("degree", [1, 2])
def test_stopped_in_every_phase(scene, targets, tmp_path, degree):
    """In codebooks and in steps: resuming repeats only the steps after the last saved state."""
    recipe, reports = replace(RECIPE, degree=degree), []
    whole, broken = (Checkpoints(tmp_path / name, "key") for name in ("whole", "broken"))
    *_, wanted = compress(scene, targets, recipe, whole)

    def progress(phase, done, total, loss):
        if loss is None:
            return
        reports.append((phase, done))
        if done == STOPS[phase] and reports.count((phase, done)) == 1:
            raise Stop

    stops = 0
    while not broken.find("quantize"):
        try:
            list(compress(scene, targets, recipe, broken, DEFAULT, progress))
        except Stop:
            stops += 1
            assert broken.unfinished.exists()
            broken = Checkpoints(broken.folder, broken.key)
    phases = list(dict.fromkeys(phase for phase, _ in reports))
    assert phases == [phase for phase in STOPS if degree == 1 or phase != "distill 1"]
    assert stops == len(phases)
    for phase in phases:
        steps = [done for name, done in reports if name == phase]
        stop = STOPS[phase]
        assert steps == [*range(1, stop + 1), stop, stop + 1], phase
    assert not list(broken.folder.glob("*.pt")) and len(broken.steps) == len(whole.steps)
    assert [step.loss for step in broken.steps] == [step.loss for step in whole.steps]
    found = broken.load(broken.last)
    assert np.array_equal(found.image, whole.load(wanted).image)


@pytest.mark.parametrize("degree", [1, 2])
def test_what_refresh_took_is_kept(scene, tmp_path, degree):
    """A state restores all that refresh() computed: units, grids of positions and of harmonics,
    entries. A fresh object that loads it renders the same bits."""
    start = scene.with_sh_degree(degree)

    def begin():
        if degree == 2:
            return InSteps(tensors_of(start), DEFAULT, "balanced")
        count = len(start)
        seen = Directions(np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3)))
        return in_codebooks(start, np.ones(count), seen, DEFAULT, 0)

    def adams(work):
        leaves, rates = work.leaves()
        return refining(leaves, 1.0, rates)

    first, second = begin(), begin()
    before = [each.detach().clone() for each in first.rendered(first.tensors)]
    rng = torch.Generator().manual_seed(0)
    for _ in range(2):
        with torch.no_grad():
            for leaf in first.tensors.values():
                leaf += torch.randn(leaf.shape, generator=rng)
        first.refresh()
    kept = Unfinished(tmp_path / "a.pt", first.taken)
    kept.save(adams(first), 1, 0.5)
    Unfinished(kept.path, second.taken).load(adams(second))
    changed = first.rendered(first.tensors)
    for found, wanted, old in zip(second.rendered(second.tensors), changed, before, strict=True):
        assert torch.equal(found, wanted) and not torch.equal(wanted, old)
    assert not torch.equal(first.unit, begin().unit)


def state_of(*leaves: torch.Tensor):
    """Optimizers of leaves [N] after one step."""
    for leaf in leaves:
        leaf.grad = torch.ones_like(leaf)
    adams = {str(k): torch.optim.Adam([leaf], lr=0.5) for k, leaf in enumerate(leaves)}
    for adam in adams.values():
        adam.step()
    return adams


def test_nothing_is_kept_at_first(tmp_path):
    assert Unfinished(tmp_path / "a.pt").load({}) == (0, None)


def test_learning_rates_are_those_of_the_caller(tmp_path):
    """A state holds parameters and moments, not learning rates."""
    adams = state_of(torch.zeros(3, requires_grad=True))
    kept = Unfinished(tmp_path / "a.pt")
    kept.save(adams, 7, 0.25)
    leaf = torch.ones(3, requires_grad=True)
    again = {"0": torch.optim.Adam([leaf], lr=0.125)}
    assert kept.load(again) == (7, 0.25)
    assert torch.allclose(leaf, torch.full((3,), -0.5)) and leaf.requires_grad
    assert again["0"].param_groups[0]["lr"] == 0.125
    assert int(again["0"].state[leaf]["step"]) == 1


def test_broken_states_are_named(tmp_path):
    kept = Unfinished(tmp_path / "a.pt")
    adams = state_of(torch.zeros(3, requires_grad=True))
    kept.save(adams, 1, 0.5)
    whole = kept.path.read_bytes()
    others = [state_of(torch.ones(1, requires_grad=True)), state_of(torch.ones(3), torch.ones(3))]
    for other in others:
        refused(r"a.pt: belongs to a different fine-tuning; remove", kept.load, other)
    for share in (0.0, 0.5, 0.99):
        kept.path.write_bytes(whole[: int(share * len(whole))])
        refused(r"a.pt: is not a state of .*; remove it", kept.load, adams)


def test_what_cannot_be_written_is_named(tmp_path):
    kept = Unfinished(tmp_path / "gone" / "a.pt")
    refused(r"gone/a.pt: cannot be written", kept.save, {}, 1, 0.5)


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
    message = r"training run \(78 points, 2 steps, seed 0, antialiased\)"
    refused(message, train, photographs, points, 2, 0, tmp_path, nothing)
