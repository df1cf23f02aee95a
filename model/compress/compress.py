"""Compression in steps: prune and fine-tune, distil, quantise, pack.

Each finished step is kept in a folder (`model.compress.checkpoint`), so that a later run resumes.
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
from splatcore.model.compress.distill import degrees, distill
from splatcore.model.compress.judge import best_looking, decibels, spread
from splatcore.model.compress.prune import prune, sound
from splatcore.model.compress.quantize import REFRESH, Quantised
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.significance import directions_of, significance
from splatcore.model.compress.steps import InSteps
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients import trainable
from splatcore.model.gradients.finetune import Progress, Run, Unfinished, finetune
from splatcore.model.pack.pack import pack
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

ASIDE, ASIDE_MOST = 7, 24
"""With a target PSNR or a maximum drop, one of ASIDE views is held out, at most ASIDE_MOST."""

FITTED = 96  # views, at most, to which a lower degree of harmonics is fitted

PRUNING_SHARE = 0.6
"""Share of the loss that pruning may use up; the rest is for distillation and quantisation."""

ATTEMPTS, CLOSE = 3, 0.5
"""A search for a target PSNR ends after ATTEMPTS models if one reaches it, or within CLOSE dB."""

DOUBLED = 3.0  # dB gained by doubling the Gaussians, about (leica-sofort 3.5, skull 2.3)

RATE_MIN = 0.05  # smallest pruning rate that is tried
FASTER, FASTER_STEPS = 0.1, 0.25
"""Shares of the Gaussians and of the steps of each further pruning of a scene that is too slow."""


def compress(
    scene: Scene,
    targets: Sequence[Target],
    recipe: Recipe,
    checkpoints: Checkpoints,
    config: Config = DEFAULT,
    progress: Progress = lambda phase, done, total, loss: None,
    original: int | None = None,
    speed: Speed | None = None,
) -> Iterator[Step]:
    """Compress a scene to a packed model; yield each finished step, "quantize" last.

    targets: cameras and pictures to learn from, photographs or the scene's own
    checkpoints: finished steps; steps that exist are yielded without being computed again
    config: the machine that the model is for
    original: bytes that ratios refer to (default: the scene as a PLY)
    speed: estimates frames per second; needed with such a target

    The caller may stop after any step. Raises InputError if no Gaussian is visible, if the degree
    or the target cannot be reached, and if the loss becomes NaN; finished steps are kept.
    """
    recipe.check(scene, config)
    scene = sound(scene)
    try:
        recipe = decide(scene, targets, recipe, checkpoints, config, progress, original, speed)
        work = Compression(tuple(targets), recipe, checkpoints, config, progress, speed)
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
        kept = f"; finished steps are in {checkpoints.folder}" if checkpoints.steps else ""
        raise InputError(f"{scene.name}: {error}{kept}") from None


Steps = Generator[Step, None, Scene]
"""Yields finished steps and returns the scene after the last one."""


@dataclass(eq=False)
class Compression:
    """The steps of one compression; each is kept when it is finished."""

    targets: tuple[Target, ...]
    recipe: Recipe
    checkpoints: Checkpoints
    config: Config
    progress: Progress
    speed: Speed | None = None
    cameras: list[Camera] = field(init=False)
    extent: float = field(init=False)  # of the cameras, scene units
    names: list[str] = field(default_factory=list)
    weighed: tuple[Scene, np.ndarray] | None = None

    def __post_init__(self):
        self.cameras = [target.camera for target in self.targets]
        self.extent = trainable.extent_of(self.cameras)

    def next_name(self, text: str) -> str:
        """The name of the next step of that text; the second one is "… (2)"."""
        count = self.names.count(text) + 1
        return text if count == 1 else f"{text} ({count})"

    def step(
        self, text: str, kind: str, make: Callable[[], tuple[Result, float | None]]
    ) -> Generator[Step, None, Result]:
        """Take a step from the checkpoints, or make and keep it; yield it and return its scene or
        model.

        make: returns the scene or model, and the loss
        """
        name = self.next_name(text)
        self.names.append(text)
        step = self.checkpoints.find(name)
        if step is None:
            begin = time.monotonic()
            result, loss = make()
            step = self.checkpoints.save(name, kind, result, time.monotonic() - begin, loss)
        yield step
        return self.checkpoints.load(step)

    def weights(self, scene: Scene, phase: str) -> np.ndarray:
        """Significance [N] over at most WEIGHED training views, cached for the last scene."""
        if self.weighed and self.weighed[0] is scene:
            return self.weighed[1]
        found = significance(scene, spread(self.cameras, WEIGHED), self.progress, phase)
        self.weighed = scene, found
        return found

    def run(self, phase: str, steps: int, left: float) -> Run:
        """A run of steps whose state is kept."""
        return Run(phase, steps, left, self.progress, Unfinished(self.checkpoints.unfinished))

    def pruned(self, scene: Scene, rate: float, share: float = 1.0) -> Steps:
        """Prune by `rate`, then fine-tune with a share of the recipe's steps."""
        name = f"prune {rate:.3g}"

        def make() -> tuple[Scene, float | None]:
            smaller = prune(scene, self.weights(scene, name), rate)
            tensors, recipe = trainable.tensors_of(smaller), self.recipe
            adams = trainable.refining(tensors, recipe.rate)
            run = self.run(name, round(share * recipe.steps), recipe.learning.left)
            loss = finetune(
                tensors, adams, self.targets, recipe.seed, run, antialiased=scene.antialiased
            )
            learned = sound(trainable.scene_of(tensors, scene))
            return best_looking((smaller, learned), self.targets), loss

        return self.step(name, "prune", make)

    def distilled(self, scene: Scene, degree: int) -> Steps:
        """Reduce the harmonics to `degree` by distillation."""
        name = f"distill {degree}"

        def make() -> tuple[Scene, float | None]:
            cameras, recipe = spread(self.cameras, FITTED), self.recipe
            run = self.run(name, recipe.distill_steps, recipe.learning.left)
            student, loss = distill(scene, degree, cameras, self.extent, recipe, run)
            return sound(trainable.scene_of(student, scene)), loss

        return self.step(name, "distill", make)

    def lowered(self, scene: Scene) -> Steps:
        """Reduce the harmonics, degree by degree, to the highest degree that the model may have."""
        for degree in degrees(scene, min(self.config.sh_degree, self.recipe.highest)):
            scene = yield from self.distilled(scene, degree)
        return scene

    def before_pruning(self, scene: Scene) -> Steps:
        """The scene with which pruning begins."""
        if self.recipe.order == "distill-first":
            scene = yield from self.lowered(scene)
        return scene

    def packed(self, scene: Scene) -> Generator[Step, None, PackedModel]:
        """Quantise and pack a pruned scene, after reducing its harmonics to the model's degree."""
        scene = yield from self.lowered(scene)
        name = self.next_name("quantize")
        return (yield from self.step("quantize", "quantize", lambda: self.quantised(scene, name)))

    def quantised(self, scene: Scene, name: str) -> tuple[PackedModel, float | None]:
        """Quantise a scene and fine-tune it under the model's number formats."""
        work = self.under_numbers(scene, name)
        first = work.packed(scene)
        leaves, rates = work.leaves()

        def progress(phase: str, done: int, total: int, loss: float | None):
            if done % REFRESH == 0:
                work.refresh()
            self.progress(phase, done, total, loss)

        recipe, learning = self.recipe, self.recipe.learning
        adams = trainable.refining(leaves, learning.numbers * recipe.rate, rates)
        kept = Unfinished(self.checkpoints.unfinished, work.taken)
        run = Run(name, recipe.quantize_steps, learning.last, progress, kept)
        seed, mark = recipe.seed + 1, scene.antialiased
        loss = finetune(work.tensors, adams, self.targets, seed, run, work.rendered, mark)
        return best_looking((first, work.packed(scene)), self.targets), loss

    def under_numbers(self, scene: Scene, name: str) -> Quantised:
        """Set up a scene for fine-tuning under the number formats of its model."""
        recipe, quality = self.recipe, self.recipe.packing["quality"]
        if recipe.in_steps:
            self.progress(f"{name}: steps", 0, 1, None)
            return InSteps(trainable.tensors_of(scene), self.config, quality)
        self.progress(f"{name}: codebooks", 0, 1, None)
        weight = self.weights(scene, name)
        seen = directions_of(scene, spread(self.cameras, WEIGHED))
        return in_codebooks(scene, weight, seen, self.config, recipe.seed, quality)

    def fast_enough(self, scene: Scene, wanted: float) -> Steps:
        """Prune a scene further until the machine renders it at `wanted` frames per second."""
        cameras = spread(self.cameras, TIMED)
        while self.speed(pack(scene, self.config, **self.recipe.packing)[0], cameras) < wanted:
            scene = yield from self.pruned(scene, FASTER, FASTER_STEPS)
        return scene

    def keep_aside(self) -> tuple[Target, ...]:
        """Hold out some of the targets: remove them from training, return them for evaluation."""
        aside = spread(self.targets[::ASIDE], ASIDE_MOST)
        self.targets = tuple(target for k, target in enumerate(self.targets) if k % ASIDE)
        if not self.targets:
            raise InputError("one picture is too few: another one has to be held out")
        self.cameras, self.weighed = [target.camera for target in self.targets], None
        return aside

    def within(self, scene: Scene, drop: float) -> Iterator[Step]:
        """Prune as far as the held-out views allow, then pack the most pruned scene whose model
        loses at most `drop` dB on them."""
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
        lost = f"the model loses {best - found:.2f} dB even without pruning"
        raise InputError(f"--max-drop: {drop:g} dB cannot be kept: {lost}")

    def reaching(self, scene: Scene, wanted: float) -> Iterator[Step]:
        """Make models until one has `wanted` dB on the held-out views with few Gaussians; yield the
        smallest one that has last. The PSNR of each gives the number of Gaussians of the next."""
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
                fault = f"without pruning it is {found:.2f} dB"
                raise InputError(f"--target-psnr: {wanted:g} dB: {fault}")
            else:
                too_few = count
            expected = count * 2 ** ((wanted + CLOSE / 2 - found) / DOUBLED)
            near = attempt >= ATTEMPTS or 0 <= found - wanted <= CLOSE
            count = min(max(round(expected), too_few + 1), enough)
            if model_of_these and (near or count == enough):
                break
        yield self.checkpoints.find(model_of_these)
