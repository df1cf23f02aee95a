"""What a model shall be: degree, quality and number of Gaussians, chosen by trials on the scene.

A trial merges Gaussians and fits the harmonics that stay by least squares, packs the result and
looks at it, without fine-tuning. That favours models in steps (`STEPS_LEARN`), and else changes
hardly more than near ties (docs/compression.md).
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
from splatcore.model.gradients.finetune import Tell
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
"""Frames a second of a machine with a model, mean over cameras."""

TIMED = 3  # views by which frames a second are told
WEIGHED = 48  # views of which significance is the sum, at most

TIE = 0.1
"""dB by which a model has to be better than one of a lower degree."""

LEARNED = 2.0
"""dB that fine-tuning gives back, at least, of what a trial has lost (eleven models of four scenes:
1.4 to 7); by so much a trial may miss the PSNR that is asked for."""

STEPS_LEARN = 1.2
"""dB that a model in steps learns more than one in codebooks of as many bytes, where harmonics are
worth something (skull and leica-sofort at 40 to 80 times; docs/compression.md)."""

REACHED = 6.0
"""dB that a compact model of all Gaussians may gain by fine-tuning, at most."""

LEAST = 0.01  # share of the Gaussians that a trial keeps at least
HALVINGS = 6  # of the logarithm of the number of Gaussians, in a search


@dataclass(frozen=True)
class Trial:
    """A model that was tried. psnr_db: against the pictures to be learned from, before it learns;
    None if there was nothing to choose. fps: where these are asked for."""

    degree: int
    quality: str  # of QUALITIES
    gaussians: int
    bytes: int
    psnr_db: float | None
    fps: float | None = None


@dataclass(eq=False)
class Trials:
    """Tries models of a scene; Gaussians are merged once for all trials of as many or fewer."""

    scene: Scene
    targets: Sequence[Target]
    recipe: Recipe
    config: Config
    tell: Tell
    speed: Speed | None = None
    levels: list[tuple[Scene, np.ndarray]] = field(default_factory=list)  # with significances
    done: list[Trial] = field(default_factory=list)

    def __post_init__(self):
        self.cameras = [target.camera for target in spread(self.targets, WEIGHED)]

        def tell(done: int, total: int):
            self.tell("choice: looking", done, total, None)

        weight = significance(self.scene, self.cameras, tell)
        if not weight.any():
            raise InputError("none of the views shows a Gaussian")
        self.levels.append((self.scene, weight))

    def packings(self) -> list[tuple[int, str]]:
        """Degrees and qualities that the model may have: the recipe's, or all that there are."""
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
        """Gaussians of a model of so many bytes, at most those of the scene."""
        return min(count_in(size, *sizes(self.config, degree, quality)), len(self.scene))

    def merged(self, count: int) -> Scene:
        """The scene with so many Gaussians."""
        scene, weight = min((e for e in self.levels if len(e[0]) >= count), key=lambda e: len(e[0]))
        if len(scene) > count:
            self.tell(f"choice: {count} Gaussians", 0, 1, None)
            self.levels.append(merged(scene, weight, 1 - count / len(scene)))
            scene = self.levels[-1][0]
        return scene

    def model(self, degree: int, quality: str, count: int) -> PackedModel:
        """The model, without fine-tuning."""
        scene = self.merged(count)
        if degree < scene.sh_degree:
            scene = projected(scene, degree, self.cameras)
        self.tell(f"choice: packing {count} Gaussians, degree {degree}", 0, 1, None)
        return pack(scene, self.config, degree, quality=quality)[0]

    def tried(self, degree: int, quality: str, count: int) -> Trial:
        """What the model is worth."""
        model = self.model(degree, quality, count)
        worth = decibels(model.gaussians(), spread(self.targets, JUDGED))
        fps = self.fps(model) if self.recipe.target_fps else None
        self.done.append(Trial(degree, quality, count, len(model.image), worth, fps))
        return self.done[-1]

    def fps(self, model: PackedModel) -> float:
        """Frames a second in the views that stand for all."""
        self.tell(f"choice: cycles of {len(model)} Gaussians", 0, 1, None)
        return self.speed(model, [target.camera for target in spread(self.targets, TIMED)])


def decide(
    scene: Scene,
    targets: Sequence[Target],
    recipe: Recipe,
    checkpoints: Checkpoints,
    config: Config = DEFAULT,
    tell: Tell = lambda what, done, total, loss: None,
    original: int | None = None,
    speed: Speed | None = None,
) -> Recipe:
    """The recipe with what it leaves open chosen: the degree and quality of the model, and what
    each pruning removes. Takes what `compress` takes; what was chosen once stands."""
    if not targets:
        raise InputError("there is no picture to learn from")
    if recipe.degree is not None and not recipe.targeted:
        return recipe

    def make() -> dict:
        kept = sound(scene)
        size = original or ply_bytes(len(kept), kept.sh_degree)
        return choose(Trials(kept, targets, recipe, config, tell, speed), size)

    return resolved(recipe, checkpoints.choose(make))


def choose(trials: Trials, original: int) -> dict:
    """The `trials` (fields of `Trial`), which of them was `chosen`, and the `schedule` of prunings
    that leaves its Gaussians. InputError if the recipe's target cannot be reached, with what can.

    original: bytes that ratios are counted from.
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
    """The recipe with what was chosen in place of what was left open."""
    trial = Trial(**choice["trials"][choice["chosen"]])
    rates = tuple(choice["schedule"]) if recipe.max_drop is None else recipe.schedule
    steps = recipe.steps * max(len(recipe.schedule), 1) if recipe.targeted else recipe.steps
    return replace(
        recipe, degree=trial.degree, quality=trial.quality, schedule=rates, steps=steps,
        target_ratio=None, target_bytes=None,
    )  # fmt: skip


def room(trials: Trials, original: int) -> float:
    """Bytes that the model may have: those asked for, else what a compact one has after the
    recipe's prunings."""
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
    """The best model of at most so many bytes."""
    fits = [(trials.room_for(*packing, size), packing) for packing in trials.packings()]
    smallest = min(format.layout(1, beats).end for format, beats in
                   (sizes(trials.config, *packing) for _, packing in fits))  # fmt: skip
    fits = [found for found in fits if found[0]]
    if not fits:
        option = "--target-bytes" if trials.recipe.target_bytes is not None else "--target-ratio"
        raise InputError(f"{option}: leaves {size:.0f} bytes, and a model has {smallest} at least")
    if len(fits) == 1:  # nothing to choose
        count, packing = fits[0]
        trials.done.append(Trial(*packing, count, round(size), None))
        return trials.done[0]
    fits.sort(key=lambda found: -found[0])
    return best_of([trials.tried(*packing, count) for count, packing in fits])


def best_of(found: list[Trial]) -> Trial:
    """The trial that promises the most dB once it has learned, and of those that promise as much
    the one of the lowest degree."""
    more = STEPS_LEARN if harmonics_matter(found) else 0.0

    def promised(trial: Trial) -> float:
        return trial.psnr_db + more * (trial.quality in STEPPED)

    most = max(map(promised, found))
    good = [trial for trial in found if promised(trial) >= most - TIE]
    return min(good, key=lambda trial: (trial.degree, trial.bytes))


def harmonics_matter(found: list[Trial]) -> bool:
    """True if of the trials in codebooks the best of degree 1 is better than that of degree 0, so
    that there is something for harmonics in steps to learn."""
    codebooks = [trial for trial in found if trial.quality in INDEXED]
    plain, turning = (
        max((trial.psnr_db for trial in codebooks if trial.degree == degree), default=-inf)
        for degree in (0, COMPACT_DEGREE)
    )
    return turning > plain + TIE


def edge(low: int, high: int, over: Callable[[int], bool]) -> tuple[int, int]:
    """Numbers of Gaussians close to each other, the second of which is `over`; as `high` is, and
    `low` is not."""
    for _ in range(HALVINGS):
        middle = round(sqrt(low * high))
        if low < middle < high:
            low, high = (low, middle) if over(middle) else (middle, high)
    return low, high


def least(trials: Trials) -> int:
    """The fewest Gaussians that are tried in a search."""
    return max(round(LEAST * len(trials.scene)), 1)


def for_psnr(trials: Trials, wanted: float) -> Trial:
    """The smallest model from which fine-tuning will come to so many dB."""
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
    what = f"degree {best.degree}, {best.quality}, has {best.psnr_db:.1f} dB before it learns"
    raise InputError(f"--target-psnr: {wanted:g} dB: the best model of all Gaussians, {what}")


def for_fps(trials: Trials, wanted: float) -> Trial:
    """The best model with which the machine is so fast."""
    cheapest = trials.packings()[0]

    def fps(count: int) -> float:
        return trials.fps(trials.model(*cheapest, count))

    low, count = least(trials), len(trials.scene)
    if fps(count) < wanted:
        most = fps(low)
        if most < wanted:
            what = f"with {low} Gaussians, 1 % of all, {trials.config.name} makes {most:.0f}"
            raise InputError(f"--target-fps: {wanted:g}: {what}")
        count, _ = edge(low, count, lambda some: fps(some) < wanted)
    found = [trials.tried(*packing, count) for packing in trials.packings()]
    return best_of([trial for trial in found if trial.fps >= wanted] or found[:1])


def sizes(config: Config, degree: int, quality: str) -> tuple:
    """The format of a model, and beats of harmonics of each Gaussian."""
    beats = LAYOUTS[layout_of(quality, degree)].beats if quality in STEPPED else 0
    return format_of(config, quality, degree), beats
