"""Training and compression for commands: with progress bars, and PyTorch imported on demand."""

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
from splatcore.sim.common.output import messages, progress_bar
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.spec.cache import digest
from splatcore.spec.camera import Camera
from splatcore.spec.config import CLOCK_HZ, Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.scene import Scene

BESIDE_SHARE = 1.0
"""Share of a teacher's views that are off the path. On leica-sofort it keeps the mean loss off the
path within 1 dB of the loss on the path (docs/notes/2026-11-compression.md)."""


def check_installed():
    """Raise InputError if PyTorch is missing. Call this before long work."""
    if find_spec("torch") is None:
        raise InputError("needs PyTorch: pip install 'splatcore[compress]'")


@contextmanager
def progress(label: str):
    """Show a progress bar; yield the callback for training and compression."""
    with progress_bar(label) as advance:

        def report(phase: str, done: int, total: int, loss: float | None = None):
            shown = "" if loss is None else f", loss {loss:.5f}"
            advance(done, total, f"{label}: {phase}{shown}")

        yield report


def photographs(
    path: str, scale: float, every: int, reading: Reading = AS_STATED
) -> tuple[tuple, tuple]:
    """Read photographs and print notes on them; return training and held-out targets.

    scale: factor of the pictures' sides
    every: one in `every` photographs is held out
    """
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
    """Train the baseline of a folder of photographs. antialiased: as in `train`."""
    from splatcore.model.compress.train import train

    with progress(f"{label}: training") as report:
        return train(targets, read_points(path), steps, seed, folder, report, antialiased)


def pictures_at(scene: Scene, cameras: list[Camera], size: tuple[int, int]) -> tuple:
    """Render the scene's own pictures from cameras, scaled to the width of `size`."""
    from splatcore.model.compress.teacher import pictures

    sized = [
        camera.resized(size[0], max(round(camera.height * size[0] / camera.width), 1))
        for camera in cameras
    ]
    return pictures(scene, sized)


def compressed(
    scene: Scene, targets: tuple, recipe, checkpoints, config, label: str
) -> PackedModel:
    """Compress a scene to a packed model; finished steps in `checkpoints` are reused."""
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
    """A compression of a subject by a recipe, in its own folder within `folder`.

    The folder's name contains a digest of everything that the run depends on, so runs with other
    options are kept.
    """

    def __init__(self, folder: Path, subject, recipe: Recipe, config: Config):
        self.subject, self.recipe, self.config = subject, recipe, config
        self.key = f"{subject.key} {recipe!r} {config!r}"
        self.folder = folder
        self.checkpoints = Checkpoints(folder / f"{subject.name}-{digest(self.key)[:12]}", self.key)

    def finish(self) -> Step:
        """Run to the last step, "quantize", and return it."""
        return self.until(lambda step: step.kind == "quantize")

    def prune(self) -> Step:
        """Run to the last pruning step and return it; the rest of the recipe is not run."""
        return self.until(lambda step: step.kind == "prune", len(self.recipe.schedule))

    def until(self, wanted: Callable[[Step], bool], count: int = 1) -> Step:
        """Run to the `count`-th step for which `wanted` holds, and return it."""

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
        """Copy the steps of distillation from a run that recipes of this order and degree share.

        Only if distillation comes before pruning. recipe: result of `decide`
        """
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
        """Remove the files of all steps except the last; a finished run does not need them."""
        for step in self.checkpoints.steps[:-1]:
            (self.checkpoints.folder / step.file).unlink(missing_ok=True)
