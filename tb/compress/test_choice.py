"""Choice of a model's degree, quality and number of Gaussians: trials, targets; models in steps."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from splatcore.golden.pipeline import render as golden_render
from splatcore.golden.reference import render as reference
from splatcore.model.compress import choice as choice_module
from splatcore.model.compress import compress as compress_module
from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.choice import Trial, Trials, best_of, choose, resolved
from splatcore.model.compress.compress import Compression, compress, decide
from splatcore.model.compress.judge import decibels
from splatcore.model.compress.quantize import REFRESH
from splatcore.model.compress.steps import InSteps
from splatcore.model.compress.teacher import teacher_targets
from splatcore.model.gradients.differentiable import render
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.metric import psnr
from splatcore.spec.colour import COARSE, FINE, SECOND
from splatcore.spec.config import DEFAULT
from splatcore.spec.error import InputError
from splatcore.spec.memory import model_format, step_format
from splatcore.spec.preset import find_preset
from tb.helpers.compression_scene import RECIPE, SIZE, nothing


def trials(scene, targets, config=DEFAULT, speed=None, **changes) -> Trials:
    return Trials(scene, targets, replace(RECIPE, **changes), config, nothing, speed)


def speed(model, cameras) -> float:
    """Frames per second of a machine that needs 1,000 cycles per Gaussian at 800 MHz."""
    assert len(cameras) == 3
    return 8e5 / len(model)


def test_degree_follows_what_harmonics_are_worth(scene):
    """At equal size: degree 0 for negligible harmonics, 2 or 3 for strong ones."""
    rng = np.random.default_rng(0)
    for strength, degrees in ((0.0, {0}), (0.4, {2, 3})):
        sh = scene.sh.copy()
        sh[:, 1:] = strength * rng.choice([-1, 1], (len(scene), 15, 3))
        own = replace(scene, sh=sh)
        found = trials(own, teacher_targets(own, 6, SIZE, 0), target_ratio=8.0)
        size = ply_bytes(len(scene), 3)
        chosen = choose(found, size)
        one = chosen["trials"][chosen["chosen"]]
        assert one["degree"] in degrees
        assert {row["degree"] for row in chosen["trials"]} == {0, 1, 2, 3}
        assert all(row["bytes"] <= size / 8 for row in chosen["trials"])
        assert one["psnr_db"] >= max(row["psnr_db"] for row in chosen["trials"]) - 0.1
        kept = np.prod(1 - np.array(chosen["schedule"]))
        assert round(kept * len(scene)) == one["gaussians"]


def test_a_size_is_reached_by_one_pruning(scene, targets, checkpoints):
    """With a target: one pruning, with all steps of the schedule. Without: the schedule."""
    recipe = replace(RECIPE, target_ratio=20.0)
    found = decide(scene, targets, recipe, checkpoints)
    assert len(recipe.schedule) == 2 and len(found.schedule) == 1
    assert found.steps == 2 * recipe.steps and found.quantize_steps == recipe.quantize_steps
    other = Checkpoints(checkpoints.folder / "other", "")
    found = decide(scene, targets, replace(RECIPE, degree=None), other)
    assert len(found.schedule) == 2 and found.steps == recipe.steps


def test_lower_degree_of_two_that_are_as_good():
    """Within 0.1 dB of the best trial, the lowest degree wins."""
    rows = [
        Trial(degree, "compact", 9, 100 - degree, db)
        for degree, db in ((0, 30.1), (1, 30.35), (2, 30.44), (3, 30.4))
    ]
    assert best_of(rows).degree == 1
    assert best_of(rows[2:]).degree == 2


def test_steps_learn_more_where_harmonics_are_worth_something():
    """In a trial, before fine-tuning, a model in steps may be a little behind one in codebooks."""

    def chosen(none: float, codebooks: float, steps: float) -> str:
        rows = (0, "compact", none), (1, "small", codebooks), (3, "balanced", steps)
        return best_of([Trial(degree, quality, 9, 9, db) for degree, quality, db in rows]).quality

    assert chosen(30.0, 31.0, 30.0) == "balanced"
    assert chosen(30.0, 31.0, 29.8) == "small"
    assert chosen(31.0, 31.0, 30.5) == "compact"
    assert chosen(31.0, 30.0, 31.5) == "balanced"


def test_learning_never_loses(scene, targets, checkpoints):
    """Fine-tuning that makes the pictures worse, here by a huge learning rate, is dropped."""
    bad = replace(RECIPE, degree=3, quality="faithful", schedule=(0.28,), steps=30, rate=10.0)
    *_, step = compress(scene, targets, bad, checkpoints)
    assert decibels(checkpoints.load(step).gaussians(), targets) > 50


def test_only_what_the_machine_reads(scene, targets):
    """Trials cover packings that the machine reads, of the degree and quality given, if any."""
    compact = [(0, "compact"), (1, "compact")]
    indexed = [(0, "small"), (0, "compact"), (1, "small"), (1, "compact")]
    every = [*indexed, (2, "balanced"), (3, "balanced"), (3, "faithful")]
    assert trials(scene, targets).packings() == every
    assert trials(scene, targets, find_preset("PAPER")).packings() == compact
    assert trials(scene.with_sh_degree(2), targets).packings() == every[:5]
    faithful = trials(scene, targets, degree=3, quality="faithful")
    assert faithful.packings() == [(3, "faithful")]
    assert trials(scene, targets, degree=0).packings() == indexed[:2]
    assert trials(scene, targets, degree=1, quality="small").packings() == [(1, "small")]


def test_harmonics_that_stay_stand_for_those_that_go(scene):
    """Lower harmonics, fitted to the views by least squares, beat truncated ones."""
    sh = np.concatenate([scene.sh[:, :4], 4 * scene.sh[:, 4:]], axis=1)
    strong = replace(scene, sh=sh)
    seen = teacher_targets(strong, 6, SIZE, 0)
    cut = pack(strong, DEFAULT, 1)[0]
    tried = trials(strong, seen).tried(1, "compact", len(strong))
    assert tried.psnr_db > decibels(cut.gaussians(), seen) + 0.3


def test_room(scene, targets):
    """A model never exceeds the room, and eight more Gaussians would."""
    found = trials(scene, targets)
    compact, steps = (model_format(DEFAULT, d) for d in (0, 1)), step_format(DEFAULT, 3)
    small = model_format(DEFAULT, 1, small=True)
    for packing, format, beats in zip(
        ((1, "small"), (0, "compact"), (1, "compact"), (2, "balanced"), (3, "faithful")),
        (small, *compact, steps, steps), (0, 0, 0, 1, 2), strict=True,
    ):  # fmt: skip
        size = ply_bytes(len(scene), 3) / 15
        count = found.room_for(*packing, size)
        assert format.layout(count, beats * count).end <= size
        assert format.layout(count + 8, beats * (count + 8)).end > size
    assert found.room_for(1, "compact", 1e9) == len(scene)


def test_without_a_target_it_is_as_large_as_the_schedule_leaves_it(scene, targets):
    left = round(0.7 * 0.8 * len(scene))
    assert (
        choice_module.room(trials(scene, targets), 0) == model_format(DEFAULT, 1).layout(left).end
    )


def test_bytes(scene, targets, checkpoints):
    *_, step = compress(scene, targets, replace(RECIPE, target_bytes=9000), checkpoints)
    assert 8500 < step.bytes <= 9000
    few = replace(RECIPE, target_bytes=100)
    with pytest.raises(InputError, match=r"--target-bytes: allows 100 bytes, the smallest .* \d+"):
        list(compress(scene, targets, few, Checkpoints(checkpoints.folder / "few", "")))


def test_frames_per_second(scene, targets, checkpoints):
    """Pruning stops at the target; if fine-tuning made the scene slower, it is pruned further."""
    recipe = replace(RECIPE, target_fps=2000.0)
    steps = list(compress(scene, targets, recipe, checkpoints, speed=speed))
    assert 330 < steps[-1].gaussians <= 400
    first = checkpoints.choice["trials"][checkpoints.choice["chosen"]]
    assert first["fps"] == pytest.approx(8e5 / first["gaussians"]) and first["fps"] >= 2000

    def slower(model, cameras) -> float:
        return speed(model, cameras) * (0.8 if again.choice else 1)

    again = Checkpoints(checkpoints.folder / "slower", "")
    steps = list(compress(scene, targets, recipe, again, speed=slower))
    assert 250 < steps[-1].gaussians <= 320
    assert [step.name for step in steps].count("prune 0.1") == 1
    with pytest.raises(InputError, match="garden: --target-fps: 200000: with 7 Gaussians, 1 %"):
        compress_all = replace(RECIPE, target_fps=2e5)
        list(
            compress(scene, targets, compress_all, Checkpoints(again.folder / "b", ""), speed=speed)
        )


def test_fast_enough_as_it_is(scene, targets):
    found = choose(trials(scene, targets, speed=speed, target_fps=500.0), 0)
    assert not found["schedule"]
    assert found["trials"][found["chosen"]]["gaussians"] == len(scene)


def test_psnr(scene, targets, checkpoints):
    """The target holds on held-out views, with fewer Gaussians than in the scene."""
    recipe = replace(RECIPE, target_psnr=27.0, steps=20, quantize_steps=20)
    *_, step = compress(scene, targets, recipe, checkpoints)
    assert decibels(checkpoints.load(step).gaussians(), targets[:: compress_module.ASIDE]) >= 27
    assert step.gaussians < len(scene)
    far = replace(recipe, target_psnr=90.0)
    with pytest.raises(InputError, match="--target-psnr: 90 dB: the best model of all"):
        list(compress(scene, targets, far, Checkpoints(checkpoints.folder / "far", "")))


@pytest.mark.parametrize(
    "wanted,slope,tried",
    [
        (27.0, 3.0, [392, 185]),  # the slope is as expected
        (27.0, 5.0, [392, 185, 305]),  # 185 are too few; the search ends after one more
        (32.9, 3.0, [392, 700]),  # 392 are too few
    ],
)
def test_search_for_psnr(scene, targets, monkeypatch, wanted, slope, tried):
    """The last PSNR decides the next count; the last model is the smallest that is good enough."""

    class Fake(Compression):
        def before_pruning(self, scene):
            yield from ()
            return scene

        def pruned(self, scene, rate):
            yield from ()
            return scene[: round((1 - rate) * len(scene))]

        def packed(self, scene):
            self.names.append("quantize")
            found.append(len(scene))
            yield len(scene)
            return scene

    def fake_decibels(gaussians, aside) -> float:
        assert len(aside) == 2
        return 30.5 + slope * np.log2(len(gaussians.opacity) / 392)

    found = []
    monkeypatch.setattr(compress_module, "decibels", fake_decibels)
    work = Fake(targets, RECIPE, None, DEFAULT, nothing)
    work.checkpoints = type("", (), {"find": lambda self, name: name})()
    *_, last = work.reaching(scene, wanted)
    assert found == tried and last == f"quantize ({len(tried)})"
    with pytest.raises(InputError, match="--target-psnr: 40 dB: without pruning it is 3"):
        list(Fake(targets, RECIPE, None, DEFAULT, nothing).reaching(scene, 40.0))


def test_a_smaller_target_takes_fewer_bytes(scene, targets):
    found = [
        choice_module.for_psnr(trials(scene, targets), wanted).bytes
        for wanted in (38.0, 30.0, 24.0)
    ]
    assert found[0] > found[1] > found[2]


def test_what_was_chosen_stands(scene, targets, checkpoints, monkeypatch):
    """A second run takes the choice from the folder and tries nothing."""
    recipe = replace(RECIPE, target_ratio=10.0)
    first = decide(scene, targets, recipe, checkpoints)
    assert first.degree is not None and first.target_ratio is None and first.schedule
    monkeypatch.delattr(choice_module, "Trials")
    again = Checkpoints(checkpoints.folder, checkpoints.key)
    assert decide(scene, targets, recipe, again) == first
    assert first == resolved(recipe, again.choice)
    plain = replace(RECIPE, degree=1)
    assert decide(scene, targets, plain, again) is plain  # nothing is left open


def test_merged_once_for_all(scene, targets):
    """Each count is merged once, and its scene kept."""
    found = trials(scene, targets)
    sizes = [len(found.merged(count)) for count in (600, 300, 450, 300, 700)]
    assert sizes == [600, 300, 450, 300, 700] and len(found.levels) == 4
    assert found.merged(300) is found.merged(300)


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
