"""Where `splatcore bench compression` calls training and compression, which need PyTorch."""

import hashlib
from collections.abc import Callable, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from splatcore.model.compress.checkpoint import Checkpoints, Step
from splatcore.model.compress.recipe import Recipe
from splatcore.sim.common.output import messages, progress_bar
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Gaussians, Scene

Tell = Callable[[str, int, int, float | None], None]
"""Called with what is done, how much of it, of how much, and the loss."""


class Enough(Exception):
    """Ends a compression after the step that is wanted; what it has saved stays."""


def check_installed():
    """InputError without PyTorch: told before the work, not after it."""
    if find_spec("torch") is None:
        raise InputError("needs PyTorch; install it by pip install 'splatcore[compress]'")


@contextmanager
def progress(label: str):
    """A bar that yields `Tell`."""
    with progress_bar(label) as advance:

        def tell(what: str, done: int, total: int, loss: float | None = None):
            shown = "" if loss is None else f", loss {loss:.5f}"
            advance(done, total, f"{label}: {what}{shown}")

        yield tell


def recipe_of(
    steps: int | None, seed: int, rate: float = Recipe.rate, order: str = Recipe.order
) -> Recipe:
    """The default recipe with another number of steps; those of its other parts in proportion."""
    recipe = Recipe(seed=seed, rate=rate, order=order)
    if steps is None:
        return recipe
    other = {
        name: round(getattr(recipe, name) * steps / recipe.steps)
        for name in ("distill_steps", "quantize_steps")
    }
    return replace(recipe, steps=steps, **other)


def photographs(path: str, scale: float, every: int) -> tuple[tuple, tuple]:
    """Photographs to learn from and held-out ones; says what is odd about them."""
    from splatcore.model.formats.photographs import held_out, read_photographs

    found = read_photographs(path, scale)
    for note in found.notes:
        messages.print(f"{path}: {note}", markup=False, soft_wrap=True)
    return held_out(found.targets, every)


def trained(path: str, targets: tuple, steps: int, seed: int, folder: Path, label: str) -> Scene:
    """The baseline of a folder of photographs."""
    from splatcore.model.compress.train import train
    from splatcore.model.formats.colmap_points import read_points

    with progress(f"{label}: training") as tell:
        return train(targets, read_points(path), steps, seed, folder, tell)


def teacher(
    scene: Scene,
    count: int,
    size: tuple[int, int],
    seed: int,
    label: str,
    cameras: Sequence[Camera] = (),
) -> tuple:
    """The scene's own pictures, to learn from: from all round, or on the path of `cameras`."""
    from splatcore.model.compress.teacher import teacher_targets

    with progress(f"{label}: teacher") as tell:
        return teacher_targets(scene, count, size, seed, tell, cameras)


def compressed(
    scene: Scene,
    targets: tuple,
    recipe: Recipe,
    checkpoints: Checkpoints,
    config: Config,
    label: str,
) -> PackedModel:
    """The scene's packed model; what is kept is not done again."""
    from splatcore.model.compress.compress import compress

    with progress(label) as tell:
        return checkpoints.model(compress(scene, targets, recipe, checkpoints, config, tell))


def pictures_at(scene: Scene, cameras: list[Camera], size: tuple[int, int], label: str) -> tuple:
    """The scene's own pictures from cameras, as wide as `size`."""
    from splatcore.model.compress.prune import sound
    from splatcore.model.compress.teacher import pictures

    cameras = [
        camera.resized(size[0], max(round(camera.height * size[0] / camera.width), 1))
        for camera in cameras
    ]
    with progress(f"{label}: teacher") as tell:
        return tuple(pictures(sound(scene), cameras, tell))


def own_views(gaussians: Gaussians, count: int, size: tuple[int, int], seed: int) -> list:
    """Views of a scene that has no cameras."""
    from splatcore.model.cameras.surround import surrounding_views

    return surrounding_views(gaussians, count, *size, seed)


class Run:
    """A compression of a subject by a recipe in a folder of its own within `folder`.

    Its name stands for all that decides on it, so runs of other options stay beside it.
    """

    def __init__(self, folder: Path, subject, recipe: Recipe, config: Config):
        self.subject, self.recipe, self.config = subject, recipe, config
        self.key = f"{subject.key} {recipe!r} {config!r}"
        digest = hashlib.sha256(self.key.encode()).hexdigest()[:12]
        self.folder = folder
        self.checkpoints = Checkpoints(folder / f"{subject.name}-{digest}", self.key)

    def finish(self) -> Step:
        """The last step, "quantize"; what is there is not done again."""
        last = self.checkpoints.last
        if last and last.kind == "quantize":
            return last
        return self._compress(lambda: False)

    def prune(self) -> Step:
        """The step after the last pruning; the rest of the recipe is not done."""

        def pruned() -> bool:
            return len(self._prunings()) == len(self.recipe.schedule)

        if not pruned():
            with suppress(Enough):
                self._compress(pruned)
        return self._prunings()[-1]

    def before(self, step: Step) -> Step:
        """The step before this one."""
        steps = self.checkpoints.steps
        return steps[steps.index(step) - 1]

    def slim(self):
        """Remove what all steps but the last one left; a finished run needs it no more."""
        for step in self.checkpoints.steps[:-1]:
            (self.checkpoints.folder / step.file).unlink(missing_ok=True)

    def _prunings(self) -> list[Step]:
        return [step for step in self.checkpoints.steps if step.kind == "prune"]

    def _distilled(self) -> "Run":
        """Distillation alone, of which all recipes of one order make use."""
        recipe = replace(self.recipe, schedule=(), target_ratio=None, steps=0)
        return Run(self.folder, self.subject, recipe, self.config)

    def _begin(self):
        """Take over what distillation before all pruning left, where there is nothing yet."""
        shared = self._distilled()
        goal = self.config.sh_degree
        if (
            self.recipe.order != "distill-first"
            or self.subject.scene.sh_degree <= goal
            or self.checkpoints.last
            or shared.key == self.key
        ):
            return

        def distilled() -> bool:
            last = shared.checkpoints.last
            return last is not None and last.sh_degree <= goal

        if not distilled():
            with suppress(Enough):
                shared._compress(distilled)
        for step in shared.checkpoints.steps:
            self.checkpoints.save(step, shared.checkpoints.scene(step))

    def _compress(self, enough: Callable[[], bool]) -> Step:
        from splatcore.model.compress.compress import compress

        self._begin()
        subject = self.subject
        with progress(subject.name) as tell:

            def listen(what: str, done: int, total: int, loss: float | None = None):
                if enough():
                    raise Enough
                tell(what, done, total, loss)

            return compress(
                subject.scene, subject.targets, self.recipe, self.checkpoints, self.config,
                listen, original=subject.ply_bytes,
            )  # fmt: skip
