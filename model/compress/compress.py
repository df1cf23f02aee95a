"""Compression, step by step: prune and fine-tune, distil, quantise, pack.

Each step is kept in a folder (`model.compress.checkpoint`), from which the next run goes on.
"""

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from splatcore.model.compress.checkpoint import Checkpoints, Result, Step, ply_bytes
from splatcore.model.compress.codebooks import in_codebooks
from splatcore.model.compress.distill import degrees, distill
from splatcore.model.compress.prune import count_for_ratio, prune, scaled_schedule, sound
from splatcore.model.compress.quantize import REFRESH, Quantised
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.significance import significance
from splatcore.model.compress.steps import InSteps
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients import trainable
from splatcore.model.gradients.differentiable import render
from splatcore.model.gradients.finetune import Tell, as_tensor, difference, finetune
from splatcore.model.pack.pack import layout_of
from splatcore.spec.camera import Camera
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import model_format, step_format
from splatcore.spec.metric import psnr_of_square
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

LOOKED_AT = 16  # views that decide whether harmonics are worth having

WORTH = 1.02
"""Harmonics are left out where the mean error without them is at most this times that with them:
as many bytes then go into finer colours, and stage 1 has less to do."""

WEIGHED_BY = 48  # views that decide about significance, where there are more to learn from
ASIDE = 7  # one view of so many is kept aside when a loss is to be kept (`max_drop`)

PRUNING_SHARE = 0.6
"""Share of the loss that pruning may use up; the rest is for distillation and quantisation."""

RATE_MIN = 0.05  # pruning rates below are not tried


def compress(
    scene: Scene,
    targets: Sequence[Target],
    recipe: Recipe,
    checkpoints: Checkpoints,
    config: Config = DEFAULT,
    tell: Tell = lambda what, done, total, loss: None,
    original: int | None = None,
) -> Iterator[Step]:
    """Compress a scene to a packed model; yields each finished step, "quantize" at last.

    The caller may stop after any step. The scene learns from `targets`: photographs, or its own
    pictures. What `checkpoints` holds already is yielded, not done again. `original` are the bytes
    that ratios are counted from (default: the scene's as a PLY). InputError if nothing of the scene
    can be seen, if the degree, the ratio or the drop cannot be reached, and where the loss is NaN;
    earlier steps stay.
    """
    recipe.check(scene, config)
    scene = sound(scene)
    original = original or ply_bytes(len(scene), scene.sh_degree)
    work = Compression(tuple(targets), recipe, checkpoints, config, tell)
    try:
        start = yield from work.step("original", "original", lambda: (scene, None))
        if recipe.max_drop is not None:
            yield from work.within_drop(start, recipe.max_drop)
            return
        rates = recipe.schedule
        if recipe.target_ratio is not None:
            count = work.count_at_ratio(original, recipe.target_ratio, scene)
            rates = scaled_schedule(rates, len(scene), count)
        start = yield from work.before_pruning(start)
        for rate in rates:
            start = yield from work.pruned(start, rate)
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
    cameras: list[Camera] = field(init=False)
    extent: float = field(init=False)  # of the cameras, scene units
    names: list[str] = field(default_factory=list)
    weighed: tuple[Scene, np.ndarray] | None = None

    def __post_init__(self):
        if not self.targets:
            raise InputError("there is no picture to learn from")
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
        """Significance [N] over WEIGHED_BY training views; that of the last scene is remembered."""
        if self.weighed and self.weighed[0] is scene:
            return self.weighed[1]

        def tell(done: int, total: int):
            self.tell(f"{what}: looking", done, total, None)

        found = significance(scene, self.cameras[:: -(-len(self.cameras) // WEIGHED_BY)], tell)
        if not found.any():
            raise InputError("none of the views shows a Gaussian")
        self.weighed = scene, found
        return found

    def pruned(self, scene: Scene, rate: float) -> Steps:
        """The scene after one pruning and fine-tuning."""
        name = f"prune {rate:.3g}"

        def make() -> tuple[Scene, float | None]:
            smaller = prune(scene, self.weights(scene, name), rate)
            tensors, recipe = trainable.tensors_of(smaller), self.recipe
            adams = trainable.optimizers(tensors, self.extent, trainable.REFINING, recipe.rate)
            steps, seed = recipe.steps, recipe.seed
            loss = finetune(tensors, adams, self.targets, steps, seed, self.tell, name)
            return sound(trainable.scene_of(tensors, scene.name)), loss

        return self.step(name, "prune", make)

    def distilled(self, scene: Scene, degree: int) -> Steps:
        """The scene with harmonics up to `degree` only."""
        name = f"distill {degree}"

        def make() -> tuple[Scene, float | None]:
            student, loss = distill(
                scene, degree, self.cameras, self.extent, self.recipe, self.tell, name
            )
            return sound(trainable.scene_of(student, scene.name)), loss

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
        """Quantise and pack a pruned scene whose harmonics go first, where they have not."""
        scene = yield from self.lowered(scene)
        if self.recipe.degree is None and scene.sh_degree == 1 and self.goes_without(scene):
            scene = yield from self.distilled(scene, 0)
        name = self.next_name("quantize")
        return (yield from self.step("quantize", "quantize", lambda: self.quantised(scene, name)))

    def quantised(self, scene: Scene, name: str) -> tuple[PackedModel, float | None]:
        """The packed model after fine-tuning under its numbers."""
        work = self.under_numbers(scene, name)
        leaves, rates = work.leaves()

        def tell(what: str, done: int, total: int, loss: float | None):
            if done % REFRESH == 0:
                work.refresh()
            self.tell(what, done, total, loss)

        rates = trainable.REFINING | rates
        adams = trainable.optimizers(leaves, self.extent, rates, self.recipe.rate)
        loss = finetune(
            work.tensors, adams, self.targets, self.recipe.quantize_steps, self.recipe.seed,
            tell, name, work.rendered,
        )  # fmt: skip
        return work.packed(scene.name), loss

    def under_numbers(self, scene: Scene, name: str) -> Quantised:
        """The scene under the numbers of the model that it becomes."""
        recipe = self.recipe
        if recipe.in_steps:
            self.tell(f"{name}: steps", 0, 1, None)
            return InSteps(trainable.tensors_of(scene), self.config, recipe.packing["quality"])
        self.tell(f"{name}: codebooks", 0, 1, None)
        return in_codebooks(scene, self.weights(scene, name), self.config, recipe.seed)

    @torch.no_grad()
    def error(self, parameters: tuple[torch.Tensor, ...], targets: Sequence[Target]) -> float:
        """Mean absolute error of the pictures of what `parameters` stand for."""
        errors = []
        for target in targets:
            picture = render(*parameters, target.camera).image
            errors.append(float(difference(picture, as_tensor(target.image, picture))))
        return float(np.mean(errors))

    def count_at_ratio(self, original: int, ratio: float, scene: Scene) -> int:
        """Gaussians of the scene's model at that ratio, in the largest format that it may have."""
        highest = min(scene.sh_degree, self.config.sh_degree, self.recipe.highest)
        if self.recipe.in_steps:
            beats = LAYOUTS[layout_of(self.recipe.packing["quality"], highest)].beats
            return count_for_ratio(original, ratio, step_format(self.config, highest), beats)
        degrees = {highest, 0} if self.recipe.degree is None else {highest}
        return min(count_for_ratio(original, ratio, model_format(self.config, d)) for d in degrees)

    def goes_without(self, scene: Scene) -> bool:
        """True if a scene of degree 1 loses its harmonics; what was decided once stands."""
        steps, done = self.checkpoints.steps, self.checkpoints.find(self.next_name("quantize"))
        before = steps[steps.index(done) - 1] if done else steps[-1]
        if before.kind == "distill" and before.sh_degree == 0:
            return True
        return not done and not self.worth_harmonics(scene)

    def worth_harmonics(self, scene: Scene) -> bool:
        """True if a model with harmonics, as k-means gives it, is better than one without."""
        weight = self.weights(scene, "are harmonics worth it")
        targets = self.targets[:: max(len(self.targets) // LOOKED_AT, 1)]

        def found(work: Quantised) -> float:
            return self.error(work.rendered(work.tensors), targets)

        flat = in_codebooks(scene.with_sh_degree(0), weight, self.config, self.recipe.seed)
        full = in_codebooks(scene, weight, self.config, self.recipe.seed)
        return found(flat) > WORTH * found(full)

    def within_drop(self, scene: Scene, drop: float) -> Iterator[Step]:
        """Prune as far as the views kept aside allow; then the most pruned scene whose packed
        model loses at most `drop` dB on them."""
        aside = self.targets[::ASIDE]
        self.targets = tuple(target for k, target in enumerate(self.targets) if k % ASIDE)
        if not self.targets:
            raise InputError("--max-drop: needs at least 2 pictures, one of them to keep aside")
        self.cameras, self.weighed = [target.camera for target in self.targets], None
        best = decibels(scene, aside)
        levels = [(yield from self.before_pruning(scene))]
        rates = self.recipe.schedule or (0.4,)
        rate = rates[0]
        while rate >= RATE_MIN and len(levels[-1]) > 1:
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


@torch.no_grad()
def decibels(scene: Scene | Gaussians, targets: Sequence[Target]) -> float:
    """PSNR in dB of the scene's pictures against the targets, over all their pixels."""
    seen = scene.gaussians() if isinstance(scene, Scene) else scene
    arrays = (seen.position, seen.factor, seen.opacity, seen.sh)
    kind = {"dtype": torch.float32, "device": trainable.device()}
    parameters = [torch.tensor(array, **kind) for array in arrays]
    squares, count = 0.0, 0
    for target in targets:
        picture = render(*parameters, target.camera).image
        squares += float(((picture.clamp(0, 1) - as_tensor(target.image, picture)) ** 2).sum())
        count += target.image.size
    return psnr_of_square(max(squares / count, np.finfo(float).tiny))
