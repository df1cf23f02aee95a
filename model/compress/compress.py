"""Compression, step by step: prune and fine-tune, distil, quantise, pack.

Each step is kept in a folder (`model.compress.checkpoint`), from which the next run goes on.
"""

import itertools
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from math import prod

import numpy as np

from splatcore.model.compress.checkpoint import Checkpoints, Result, Step
from splatcore.model.compress.choice import TIMED, WEIGHED, Speed, decide
from splatcore.model.compress.codebooks import in_codebooks
from splatcore.model.compress.directions import directions_of
from splatcore.model.compress.distill import degrees, distill
from splatcore.model.compress.judge import best_looking, decibels, spread
from splatcore.model.compress.prune import prune, sound
from splatcore.model.compress.quantize import REFRESH, Quantised
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.significance import significance
from splatcore.model.compress.steps import InSteps
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients import trainable
from splatcore.model.gradients.finetune import Tell, finetune
from splatcore.model.gradients.unfinished import Unfinished
from splatcore.model.pack.pack import pack
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

ASIDE, ASIDE_MOST = 7, 24
"""One view of so many is kept aside where a PSNR or a loss is asked for, and at most so many."""

FITTED = 96  # views, at most, by which harmonics that go are fitted

PRUNING_SHARE = 0.6
"""Share of the loss that pruning may use up; the rest is for distillation and quantisation."""

ATTEMPTS, CLOSE = 3, 0.5
"""Models that are made for a PSNR if the first one has it, at most, and dB that end the search."""

DOUBLED = 3.0  # dB that twice as many Gaussians bring, about (leica-sofort 3.5, skull 2.3)

RATE_MIN = 0.05  # pruning rates below are not tried
FASTER, FASTER_STEPS = 0.1, 0.25
"""Shares of the Gaussians and of the steps for a scene that learned and is not fast enough."""


def compress(
    scene: Scene,
    targets: Sequence[Target],
    recipe: Recipe,
    checkpoints: Checkpoints,
    config: Config = DEFAULT,
    tell: Tell = lambda what, done, total, loss: None,
    original: int | None = None,
    speed: Speed | None = None,
) -> Iterator[Step]:
    """Compress a scene to a packed model; yields each finished step, "quantize" at last.

    The caller may stop after any step. The scene learns from `targets`: photographs, or its own
    pictures. What `checkpoints` holds already is yielded, not done again. `original` are the bytes
    that ratios are counted from (default: the scene's as a PLY); `speed` is needed for frames a
    second as target. InputError if nothing of the scene can be seen, if the degree or the target
    cannot be reached, and where the loss is NaN; earlier steps stay.
    """
    recipe.check(scene, config)
    scene = sound(scene)
    try:
        recipe = decide(scene, targets, recipe, checkpoints, config, tell, original, speed)
        work = Compression(tuple(targets), recipe, checkpoints, config, tell, speed)
        start = yield from work.step("original", "original", lambda: (scene, None))
        if recipe.max_drop is not None:
            yield from work.within(start, recipe.max_drop)
            return
        if recipe.target_psnr is not None:
            yield from work.reaching(start, recipe.target_psnr)
            return
        start = yield from work.before_pruning(start)
        for rate in recipe.schedule:
            start = yield from work.pruned(start, rate)
        if recipe.target_fps is not None:
            start = yield from work.fast_enough(start, recipe.target_fps)
        yield from work.packed(start)
    except InputError as error:
        kept = f"; what came before is in {checkpoints.folder}" if checkpoints.steps else ""
        raise InputError(f"{scene.name}: {error}{kept}") from None


Steps = Generator[Step, None, Scene]
"""Yields finished steps and returns the scene that the last of them left."""


@dataclass(eq=False)
class Compression:
    """The steps of one compression, each kept when it is done."""

    targets: tuple[Target, ...]
    recipe: Recipe
    checkpoints: Checkpoints
    config: Config
    tell: Tell
    speed: Speed | None = None
    cameras: list[Camera] = field(init=False)
    extent: float = field(init=False)  # of the cameras, scene units
    names: list[str] = field(default_factory=list)
    weighed: tuple[Scene, np.ndarray] | None = None

    def __post_init__(self):
        self.cameras = [target.camera for target in self.targets]
        self.extent = trainable.extent_of(self.cameras)

    def next_name(self, text: str) -> str:
        """The name of a step to come; the second of the same text is "… (2)"."""
        count = self.names.count(text) + 1
        return text if count == 1 else f"{text} ({count})"

    def step(
        self, text: str, kind: str, make: Callable[[], tuple[Result, float | None]]
    ) -> Generator[Step, None, Result]:
        """Yields the step that is kept, else what `make` makes, with its loss; returns its scene or
        model."""
        name = self.next_name(text)
        self.names.append(text)
        step = self.checkpoints.find(name)
        if step is None:
            begin = time.monotonic()
            result, loss = make()
            step = self.checkpoints.save(name, kind, result, time.monotonic() - begin, loss)
        yield step
        return self.checkpoints.load(step)

    def weights(self, scene: Scene, what: str) -> np.ndarray:
        """Significance [N] over at most WEIGHED training views; that of the last scene is
        remembered."""
        if self.weighed and self.weighed[0] is scene:
            return self.weighed[1]

        def tell(done: int, total: int):
            self.tell(f"{what}: looking", done, total, None)

        found = significance(scene, spread(self.cameras, WEIGHED), tell)
        self.weighed = scene, found
        return found

    def pruned(self, scene: Scene, rate: float, share: float = 1.0) -> Steps:
        """The scene after one pruning and fine-tuning, of a share of the recipe's steps."""
        name = f"prune {rate:.3g}"

        def make() -> tuple[Scene, float | None]:
            smaller = prune(scene, self.weights(scene, name), rate)
            tensors, recipe = trainable.tensors_of(smaller), self.recipe
            adams = trainable.refining(tensors, recipe.rate)
            steps, seed = round(share * recipe.steps), recipe.seed
            left = recipe.learning.left
            loss = finetune(
                tensors, adams, self.targets, steps, seed, self.tell, name, left,
                kept=Unfinished(self.checkpoints.unfinished), antialiased=scene.antialiased,
            )  # fmt: skip
            learned = sound(trainable.scene_of(tensors, scene))
            return best_looking((smaller, learned), self.targets), loss

        return self.step(name, "prune", make)

    def distilled(self, scene: Scene, degree: int) -> Steps:
        """The scene with harmonics up to `degree` only."""
        name = f"distill {degree}"

        def make() -> tuple[Scene, float | None]:
            cameras = spread(self.cameras, FITTED)
            student, loss = distill(
                scene, degree, cameras, self.extent, self.recipe, self.tell, name,
                Unfinished(self.checkpoints.unfinished),
            )  # fmt: skip
            return sound(trainable.scene_of(student, scene)), loss

        return self.step(name, "distill", make)

    def lowered(self, scene: Scene) -> Steps:
        """The scene with no more harmonics than the model will have at most."""
        for degree in degrees(scene, min(self.config.sh_degree, self.recipe.highest)):
            scene = yield from self.distilled(scene, degree)
        return scene

    def before_pruning(self, scene: Scene) -> Steps:
        """The scene that pruning begins with."""
        if self.recipe.order == "distill-first":
            scene = yield from self.lowered(scene)
        return scene

    def packed(self, scene: Scene) -> Generator[Step, None, PackedModel]:
        """Quantise and pack a pruned scene; harmonics above the model's go first, if they have
        not."""
        scene = yield from self.lowered(scene)
        name = self.next_name("quantize")
        return (yield from self.step("quantize", "quantize", lambda: self.quantised(scene, name)))

    def quantised(self, scene: Scene, name: str) -> tuple[PackedModel, float | None]:
        """The packed model after fine-tuning under its numbers."""
        work = self.under_numbers(scene, name)
        first = work.packed(scene)
        leaves, rates = work.leaves()

        def tell(what: str, done: int, total: int, loss: float | None):
            if done % REFRESH == 0:
                work.refresh()
            self.tell(what, done, total, loss)

        recipe, learning = self.recipe, self.recipe.learning
        adams = trainable.refining(leaves, learning.numbers * recipe.rate, rates)
        loss = finetune(
            work.tensors, adams, self.targets, recipe.quantize_steps, recipe.seed + 1, tell, name,
            learning.last, work.rendered, Unfinished(self.checkpoints.unfinished, work.taken),
            scene.antialiased,
        )  # fmt: skip
        return best_looking((first, work.packed(scene)), self.targets), loss

    def under_numbers(self, scene: Scene, name: str) -> Quantised:
        """The scene under the numbers of the model that it becomes."""
        recipe, quality = self.recipe, self.recipe.packing["quality"]
        if recipe.in_steps:
            self.tell(f"{name}: steps", 0, 1, None)
            return InSteps(trainable.tensors_of(scene), self.config, quality)
        self.tell(f"{name}: codebooks", 0, 1, None)
        weight = self.weights(scene, name)
        seen = directions_of(scene, spread(self.cameras, WEIGHED))
        return in_codebooks(scene, weight, seen, self.config, recipe.seed, quality)

    def fast_enough(self, scene: Scene, wanted: float) -> Steps:
        """The scene pruned further until the machine makes so many frames a second of it."""
        cameras = spread(self.cameras, TIMED)
        while self.speed(pack(scene, self.config, **self.recipe.packing)[0], cameras) < wanted:
            scene = yield from self.pruned(scene, FASTER, FASTER_STEPS)
        return scene

    def keep_aside(self) -> tuple[Target, ...]:
        """Views by which models are judged, some of those that are not learned from any more."""
        aside = spread(self.targets[::ASIDE], ASIDE_MOST)
        self.targets = tuple(target for k, target in enumerate(self.targets) if k % ASIDE)
        if not self.targets:
            raise InputError("one picture to learn from is too few: another is to be kept aside")
        self.cameras, self.weighed = [target.camera for target in self.targets], None
        return aside

    def within(self, scene: Scene, drop: float) -> Iterator[Step]:
        """Prune as far as the views kept aside allow; then the most pruned scene whose packed
        model loses at most the drop on them."""
        aside = self.keep_aside()
        best = decibels(scene, aside)
        levels = [(yield from self.before_pruning(scene))]
        rates = self.recipe.schedule or (0.4,)
        rate = rates[0]
        while rate >= RATE_MIN and 0 < round(rate * len(levels[-1])) < len(levels[-1]):
            smaller = yield from self.pruned(levels[-1], rate)
            if decibels(smaller, aside) >= best - PRUNING_SHARE * drop:
                levels.append(smaller)
                rate = rates[min(len(levels) - 1, len(rates) - 1)]
            else:
                rate /= 2
        for level in reversed(levels):
            model = yield from self.packed(level)
            found = decibels(model.gaussians(), aside)
            if found >= best - drop:
                return
        lost = f"{best - found:.2f} dB are lost without pruning"
        raise InputError(f"--max-drop: {drop:g} dB cannot be kept: {lost}")

    def reaching(self, scene: Scene, wanted: float) -> Iterator[Step]:
        """Models of as many Gaussians as the PSNR of the last one on the views kept aside lets
        expect; ends with that of the fewest which has what is asked for."""
        aside = self.keep_aside()
        start = yield from self.before_pruning(scene)
        count = round(len(start) * prod(1 - rate for rate in self.recipe.schedule))
        enough, model_of_these, too_few = len(start), None, 0
        for attempt in itertools.count(1):
            name, some = self.next_name("quantize"), start
            if count < len(start):
                some = yield from self.pruned(start, 1 - count / len(start))
            found = decibels((yield from self.packed(some)).gaussians(), aside)
            if found >= wanted:
                enough, model_of_these = count, name
            elif count == len(start):
                least = f"without pruning it is {found:.2f} dB"
                raise InputError(f"--target-psnr: {wanted:g} dB: {least}")
            else:
                too_few = count
            expected = count * 2 ** ((wanted + CLOSE / 2 - found) / DOUBLED)
            near = attempt >= ATTEMPTS or 0 <= found - wanted <= CLOSE
            count = min(max(round(expected), too_few + 1), enough)
            if model_of_these and (near or count == enough):
                break
        yield self.checkpoints.find(model_of_these)
