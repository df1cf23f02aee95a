"""Training and compression for commands: progress bars, and PyTorch imported when it is needed."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from statistics import mean

from splatcore.model.compress.checkpoint import Checkpoints, Step
from splatcore.model.compress.recipe import Recipe
from splatcore.model.formats.colmap import read_points
from splatcore.model.formats.photographs import held_out, read_photographs
from splatcore.sim.common.cache import digest
from splatcore.sim.common.output import messages, progress_bar
from splatcore.sim.common.reading import AS_STATED, Reading
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

BESIDE_SHARE = 1.0
"""Share of a teacher's views that lie beside the path: of those tried on leica-sofort the one with
which the mean loss beside the path stays within 1 dB of that on it (docs/compression.md)."""


def check_installed():
    """InputError without PyTorch: raised before the work, not after it."""
    if find_spec("torch") is None:
        raise InputError("needs PyTorch; install it by pip install 'splatcore[compress]'")


@contextmanager
def progress(label: str):
    """A progress bar; yields the callback that training and compression take."""
    with progress_bar(label) as advance:

        def report(phase: str, done: int, total: int, loss: float | None = None):
            shown = "" if loss is None else f", loss {loss:.5f}"
            advance(done, total, f"{label}: {phase}{shown}")

        yield report


def photographs(
    path: str, scale: float, every: int, reading: Reading = AS_STATED
) -> tuple[tuple, tuple]:
    """Photographs to learn from and held-out ones; says what is odd about them."""
    found = read_photographs(path, scale)
    for note in found.notes:
        messages.print(f"{path}: {note}", markup=False, soft_wrap=True)
    cameras = reading.seen(target.camera for target in found.targets)
    targets = [replace(t, camera=c) for t, c in zip(found.targets, cameras, strict=True)]
    return held_out(tuple(targets), every)


def trained(
    path: str,
    targets: tuple,
    steps: int,
    seed: int,
    folder: Path,
    label: str,
    antialiased: bool = False,
) -> Scene:
    """The baseline of a folder of photographs; `antialiased` is that of `train`."""
    from splatcore.model.compress.train import train

    with progress(f"{label}: training") as report:
        return train(targets, read_points(path), steps, seed, folder, report, antialiased)


def teacher(
    scene: Scene,
    count: int,
    size: tuple[int, int],
    seed: int,
    cameras: Sequence[Camera] = (),
    beside: float = 0.0,
    near: float = NEAR_PLANE,
) -> tuple:
    """The scene's own pictures, to learn from: from all round with that near plane, or on the path
    of `cameras`, with the share `beside` off it."""
    from splatcore.model.compress.teacher import teacher_targets

    return teacher_targets(scene, count, size, seed, cameras, beside, near)


def pictures_at(scene: Scene, cameras: list[Camera], size: tuple[int, int]) -> tuple:
    """The scene's own pictures from cameras, as wide as `size`."""
    from splatcore.model.compress.teacher import pictures

    sized = [
        camera.resized(size[0], max(round(camera.height * size[0] / camera.width), 1))
        for camera in cameras
    ]
    return pictures(scene, sized)


def compressed(
    scene: Scene, targets: tuple, recipe, checkpoints, config, label: str
) -> PackedModel:
    """The scene's packed model; steps that are kept are not done again."""
    from splatcore.golden import pipeline
    from splatcore.model.compress.compress import compress
    from splatcore.sim.cycles.frame import frame_cycles

    def speed(model: PackedModel, cameras: Sequence[Camera]) -> float:
        frames = [pipeline.render(config, model, camera) for camera in cameras]
        return CLOCK_HZ / mean(frame_cycles(config, frame).frame for frame in frames)

    with progress(label) as report:
        *_, last = compress(scene, targets, recipe, checkpoints, config, report, None, speed)
    return checkpoints.load(last)


class Run:
    """A compression of a subject by a recipe in a folder of its own within `folder`.

    Its name stands for all that decides on it, so runs of other options stay beside it.
    """

    def __init__(self, folder: Path, subject, recipe: Recipe, config: Config):
        self.subject, self.recipe, self.config = subject, recipe, config
        self.key = f"{subject.key} {recipe!r} {config!r}"
        self.folder = folder
        self.checkpoints = Checkpoints(folder / f"{subject.name}-{digest(self.key)[:12]}", self.key)

    def finish(self) -> Step:
        """The last step, "quantize"."""
        return self.until(lambda step: step.kind == "quantize")

    def prune(self) -> Step:
        """The step of the last pruning; the rest of the recipe is not done."""
        return self.until(lambda step: step.kind == "prune", len(self.recipe.schedule))

    def until(self, wanted: Callable[[Step], bool], count: int = 1) -> Step:
        """The `count`-th step that is wanted; the run ends with it, and no step is done twice."""

        def pick(steps: Iterable[Step]) -> Step | None:
            return next(islice(filter(wanted, steps), count - 1, None), None)

        step = pick(self.checkpoints.steps)
        if step is None:
            from splatcore.model.compress.compress import compress, decide

            subject = self.subject
            with progress(subject.name) as report:
                about = [
                    subject.scene, subject.targets, self.recipe, self.checkpoints, self.config,
                    report, subject.ply_bytes,
                ]  # fmt: skip
                self._begin(decide(*about))
                step = pick(compress(*about))
        return step

    def _begin(self, recipe: Recipe):
        """Begin with distillation before all pruning, which all recipes of that order and degree
        share: it is a run of its own. recipe: as `decide` left it."""
        goal = min(self.config.sh_degree, recipe.highest)
        recipe = replace(recipe, schedule=(), target_ratio=None, steps=0)
        shared = Run(self.folder, self.subject, recipe, self.config)
        if (
            self.recipe.order != "distill-first"
            or self.subject.scene.sh_degree <= goal
            or self.checkpoints.last
            or shared.key == self.key
        ):
            return
        shared.until(lambda step: step.sh_degree <= goal)
        for step in shared.checkpoints.steps:
            scene = shared.checkpoints.load(step)
            self.checkpoints.save(step.name, step.kind, scene, step.seconds, step.loss)

    def slim(self):
        """Remove what all steps but the last one left; a finished run needs it no more."""
        for step in self.checkpoints.steps[:-1]:
            (self.checkpoints.folder / step.file).unlink(missing_ok=True)
