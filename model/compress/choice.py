"""Choice of a model's degree, quality and number of Gaussians, by trials on the scene.

A trial merges Gaussians, fits the remaining harmonics by least squares, packs the result and
measures its PSNR, without fine-tuning. Fine-tuning would favour models in steps (`STEPS_LEARN`
corrects for it) and otherwise hardly change more than near ties
(docs/notes/2026-11-compression.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from math import inf, sqrt

import numpy as np

from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.distill import projected
from splatcore.model.compress.judge import JUDGED, decibels, spread
from splatcore.model.compress.prune import count_in, merged, scaled_schedule, sound
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.significance import significance
from splatcore.model.formats.photographs import Target
from splatcore.model.gradients.finetune import Progress
from splatcore.model.pack.pack import format_of, layout_of, pack, qualities_of
from splatcore.model.pack.quality import COMPACT, INDEXED, STEPPED
from splatcore.spec.camera import Camera
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import DEFAULT, Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import COMPACT_DEGREE
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

Speed = Callable[[PackedModel, Sequence[Camera]], float]
"""Frames per second of a machine with a model, averaged over cameras."""

TIMED = 3  # views used to estimate frames per second
WEIGHED = 48  # views used to compute significance, at most

TIE = 0.1
"""dB by which a model has to be better than one of a lower degree."""

LEARNED = 2.0
"""dB that fine-tuning recovers at least (1.4 to 7 for eleven models of four scenes); a trial may
miss the requested PSNR by this much."""

STEPS_LEARN = 1.2
"""dB that fine-tuning improves a model in steps more than one in codebooks of equal size, if
harmonics matter (skull and leica-sofort at ratios of 40 to 80;
docs/notes/2026-11-compression.md)."""

REACHED = 6.0
"""dB that a compact model of all Gaussians may gain by fine-tuning, at most."""

LEAST = 0.01  # smallest share of the Gaussians that a trial keeps
HALVINGS = 6  # steps of a search, which bisects the logarithm of the number of Gaussians


@dataclass(frozen=True)
class Trial:
    """The result of trying a model."""

    degree: int
    quality: str  # of QUALITIES
    gaussians: int
    bytes: int
    psnr_db: float | None  # against the training pictures, before fine-tuning; None: no choice
    fps: float | None = None  # only with a target of frames per second


@dataclass(eq=False)
class Trials:
    """Tries models of a scene; merged scenes are kept for trials with fewer Gaussians."""

    scene: Scene
    targets: Sequence[Target]
    recipe: Recipe
    config: Config
    progress: Progress
    speed: Speed | None = None
    levels: list[tuple[Scene, np.ndarray]] = field(default_factory=list)  # and significances [N]
    done: list[Trial] = field(default_factory=list)

    def __post_init__(self):
        self.cameras = [target.camera for target in spread(self.targets, WEIGHED)]
        weight = significance(self.scene, self.cameras, self.progress, "choice")
        if not weight.any():
            raise InputError("no view shows a Gaussian")
        self.levels.append((self.scene, weight))

    def packings(self) -> list[tuple[int, str]]:
        """Degrees and qualities to try: the recipe's, or all that the machine renders."""
        recipe, top = self.recipe, min(self.scene.sh_degree, self.config.sh_degree)
        if recipe.quality or recipe.in_steps:
            return [tuple(recipe.packing.values())]
        indexed = [quality for quality in qualities_of(self.config) if quality in INDEXED]
        if recipe.degree is not None:
            return [(recipe.degree, quality) for quality in indexed]
        found = [(d, quality) for d in range(min(top, COMPACT_DEGREE) + 1) for quality in indexed]
        found += [(degree, STEPPED[0]) for degree in range(COMPACT_DEGREE + 1, top + 1)]
        return found + [(degree, STEPPED[1]) for degree in range(3, top + 1)]

    def room_for(self, degree: int, quality: str, size: float) -> int:
        """Number of Gaussians that fit in `size` bytes, at most all of the scene."""
        return min(count_in(size, *sizes(self.config, degree, quality)), len(self.scene))

    def merged(self, count: int) -> Scene:
        """The scene merged to `count` Gaussians."""
        scene, weight = min((e for e in self.levels if len(e[0]) >= count), key=lambda e: len(e[0]))
        if len(scene) > count:
            self.progress(f"choice: {count} Gaussians", 0, 1, None)
            self.levels.append(merged(scene, weight, 1 - count / len(scene)))
            scene = self.levels[-1][0]
        return scene

    def model(self, degree: int, quality: str, count: int) -> PackedModel:
        """The packed model, without fine-tuning."""
        scene = self.merged(count)
        if degree < scene.sh_degree:
            scene = projected(scene, degree, self.cameras)
        self.progress(f"choice: packing {count} Gaussians, degree {degree}", 0, 1, None)
        return pack(scene, self.config, degree, quality=quality)[0]

    def tried(self, degree: int, quality: str, count: int) -> Trial:
        """Try a model: measure its PSNR, and its frames per second if the recipe needs them."""
        model = self.model(degree, quality, count)
        worth = decibels(model.gaussians(), spread(self.targets, JUDGED))
        fps = self.fps(model) if self.recipe.target_fps else None
        self.done.append(Trial(degree, quality, count, len(model.image), worth, fps))
        return self.done[-1]

    def fps(self, model: PackedModel) -> float:
        """Frames per second, averaged over TIMED of the views."""
        self.progress(f"choice: cycles of {len(model)} Gaussians", 0, 1, None)
        return self.speed(model, [target.camera for target in spread(self.targets, TIMED)])


def decide(
    scene: Scene,
    targets: Sequence[Target],
    recipe: Recipe,
    checkpoints: Checkpoints,
    config: Config = DEFAULT,
    progress: Progress = lambda phase, done, total, loss: None,
    original: int | None = None,
    speed: Speed | None = None,
) -> Recipe:
    """Complete a recipe: choose the model's degree and quality, and the pruning rates; or take them
    from `checkpoints`. Parameters as in `compress`."""
    if not targets:
        raise InputError("no picture to learn from")
    if recipe.degree is not None and not recipe.targeted:
        return recipe

    def make() -> dict:
        kept = sound(scene)
        size = original or ply_bytes(len(kept), kept.sh_degree)
        return choose(Trials(kept, targets, recipe, config, progress, speed), size)

    return resolved(recipe, checkpoints.choose(make))


def choose(trials: Trials, original: int) -> dict:
    """Try models and choose one, as JSON for `Checkpoints.choose`.

    original: bytes that ratios refer to
    Returns `trials` (fields of `Trial`), the index `chosen` of one of them, and the `schedule` of
    prunings that leads to its number of Gaussians.
    Raises InputError if the recipe's target cannot be reached; it says what can.
    """
    recipe = trials.recipe
    if recipe.target_psnr is not None:
        best = for_psnr(trials, recipe.target_psnr)
    elif recipe.target_fps is not None:
        best = for_fps(trials, recipe.target_fps)
    elif recipe.max_drop is not None:
        found = [trials.tried(*packing, len(trials.scene)) for packing in trials.packings()]
        best = best_of(found)
    else:
        best = for_bytes(trials, room(trials, original))
    shape = recipe.schedule[:1] if recipe.targeted else recipe.schedule
    rates = scaled_schedule(shape, len(trials.scene), best.gaussians)
    rows = [asdict(trial) for trial in trials.done]
    return {"trials": rows, "chosen": trials.done.index(best), "schedule": list(rates)}


def resolved(recipe: Recipe, choice: dict) -> Recipe:
    """The recipe with open fields replaced by the choice."""
    trial = Trial(**choice["trials"][choice["chosen"]])
    rates = tuple(choice["schedule"]) if recipe.max_drop is None else recipe.schedule
    steps = recipe.steps * max(len(recipe.schedule), 1) if recipe.targeted else recipe.steps
    return replace(
        recipe, degree=trial.degree, quality=trial.quality, schedule=rates, steps=steps,
        target_ratio=None, target_bytes=None,
    )  # fmt: skip


def room(trials: Trials, original: int) -> float:
    """Size limit of the model in bytes: the recipe's target, or the size of a compact model after
    the recipe's prunings."""
    recipe = trials.recipe
    if recipe.target_bytes is not None:
        return recipe.target_bytes
    if recipe.target_ratio is not None:
        return original / recipe.target_ratio
    left = round(len(trials.scene) * float(np.prod(1 - np.array(recipe.schedule))))
    packings = trials.packings()
    degree, quality = max([p for p in packings if p[1] == COMPACT] or packings)
    format, beats = sizes(trials.config, degree, quality)
    return format.layout(max(left, 1), beats * max(left, 1)).end


def for_bytes(trials: Trials, size: float) -> Trial:
    """The best model of at most `size` bytes."""
    fits = [(trials.room_for(*packing, size), packing) for packing in trials.packings()]
    smallest = min(format.layout(1, beats).end for format, beats in
                   (sizes(trials.config, *packing) for _, packing in fits))  # fmt: skip
    fits = [found for found in fits if found[0]]
    if not fits:
        option = "--target-bytes" if trials.recipe.target_bytes is not None else "--target-ratio"
        raise InputError(f"{option}: allows {size:.0f} bytes, the smallest model has {smallest}")
    if len(fits) == 1:  # nothing to choose
        count, packing = fits[0]
        trials.done.append(Trial(*packing, count, round(size), None))
        return trials.done[0]
    fits.sort(key=lambda found: -found[0])
    return best_of([trials.tried(*packing, count) for count, packing in fits])


def best_of(found: list[Trial]) -> Trial:
    """The trial with the highest PSNR expected after fine-tuning; of near ties, the one with the
    lowest degree."""
    more = STEPS_LEARN if harmonics_matter(found) else 0.0

    def promised(trial: Trial) -> float:
        return trial.psnr_db + more * (trial.quality in STEPPED)

    most = max(map(promised, found))
    good = [trial for trial in found if promised(trial) >= most - TIE]
    return min(good, key=lambda trial: (trial.degree, trial.bytes))


def harmonics_matter(found: list[Trial]) -> bool:
    """True if the best codebook trial of degree 1 beats the best of degree 0: then harmonics in
    steps have something to learn."""
    codebooks = [trial for trial in found if trial.quality in INDEXED]
    plain, turning = (
        max((trial.psnr_db for trial in codebooks if trial.degree == degree), default=-inf)
        for degree in (0, COMPACT_DEGREE)
    )
    return turning > plain + TIE


def edge(low: int, high: int, over: Callable[[int], bool]) -> tuple[int, int]:
    """Bisect between `low`, which is not `over` a threshold, and `high`, which is; return two close
    numbers of Gaussians around it."""
    for _ in range(HALVINGS):
        middle = round(sqrt(low * high))
        if low < middle < high:
            low, high = (low, middle) if over(middle) else (middle, high)
    return low, high


def least(trials: Trials) -> int:
    """The smallest number of Gaussians that a search tries."""
    return max(round(LEAST * len(trials.scene)), 1)


def for_psnr(trials: Trials, wanted: float) -> Trial:
    """The smallest model that is expected to reach `wanted` dB by fine-tuning."""
    reached = []

    def good(packing: tuple[int, str], count: int) -> bool:
        trial = trials.tried(*packing, count)
        if trial.psnr_db >= wanted - LEARNED:
            reached.append(trial)
        return trial in reached

    for packing in trials.packings():
        if good(packing, len(trials.scene)):
            edge(least(trials), len(trials.scene), partial(good, packing))
    if reached:
        return min(reached, key=lambda trial: trial.bytes)
    best = best_of(trials.done)
    if best.quality in INDEXED and best.psnr_db >= wanted - REACHED:
        return best
    found = f"{best.psnr_db:.1f} dB before fine-tuning (degree {best.degree}, {best.quality})"
    raise InputError(f"--target-psnr: {wanted:g} dB: the best model of all Gaussians has {found}")


def for_fps(trials: Trials, wanted: float) -> Trial:
    """The best model that the machine renders at `wanted` frames per second."""
    cheapest = trials.packings()[0]

    def fps(count: int) -> float:
        return trials.fps(trials.model(*cheapest, count))

    low, count = least(trials), len(trials.scene)
    if fps(count) < wanted:
        most = fps(low)
        if most < wanted:
            fault = (
                f"with {low} Gaussians, 1 % of all, {trials.config.name} reaches only {most:.0f}"
            )
            raise InputError(f"--target-fps: {wanted:g}: {fault}")
        count, _ = edge(low, count, lambda some: fps(some) < wanted)
    found = [trials.tried(*packing, count) for packing in trials.packings()]
    return best_of([trial for trial in found if trial.fps >= wanted] or found[:1])


def sizes(config: Config, degree: int, quality: str) -> tuple:
    """The format of a model, and beats of harmonics per Gaussian."""
    beats = LAYOUTS[layout_of(quality, degree)].beats if quality in STEPPED else 0
    return format_of(config, quality, degree), beats
