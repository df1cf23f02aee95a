"""Subjects of the benchmark of compression: scenes with views for training and for evaluation.

Folder of photographs: a baseline is trained on some of them and evaluated on the held-out ones.
Scene file: the scene is its own teacher. Training views follow the path of the cameras in the file
next to the scene, or are all around it. Evaluation views are those cameras, or others all around;
compression never sees them.
"""

import os
import time
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from splatcore.golden.reference import render
from splatcore.model.cameras.orbit import views_beside
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.cameras.view import core_of
from splatcore.model.compress.checkpoint import Checkpoints, ply_bytes
from splatcore.model.compress.recipe import Recipe
from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.model_file import is_packed
from splatcore.model.formats.photographs import Target
from splatcore.model.generate.generate import GENERATORS
from splatcore.sim.frame.reading import AS_STATED, Reading
from splatcore.sim.frame.source import VARIABLE, camera_beside, open_source, scene_folder
from splatcore.spec.cache import digest
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.scene import ARRAYS, Scene
from splatcore.study.compression import run as compression_run

SCENES = ("banana", "flowers.spz", "playbot.spz", "skull.sog", "leica-sofort-top8192.ply")
"""Default subjects, files of the folder SPLATCORE_SCENES."""

HELD_OUT = 7  # one in 7 photographs is held out

OWN_VIEWS, OWN_SEED = 4, 1_000_003
"""Held-out views of a scene without a camera file, and the offset of their seed from the teacher's.
"""


@dataclass(frozen=True)
class Protocol:
    """Options of all subjects; all of them affect the results."""

    config: Config
    steps: int | None = None  # of fine-tuning after each pruning; None: the recipe's
    train_steps: int = 3000  # of a baseline
    views: int = 480  # training views of a scene that is its own teacher
    view_size: tuple[int, int] = (1920, 1080)  # of the training views, width and height
    beside: float = compression_run.BESIDE_SHARE  # share of the training views off a path
    size: tuple[int, int] = (1920, 1080)  # of the evaluation views
    scale: float = 1.0  # of photographs
    seed: int = 0
    rate: float = Recipe.rate  # of fine-tuning
    order: str = Recipe.order  # of pruning and distillation
    degree: int | None = Recipe.degree  # of the models
    quality: str | None = Recipe.quality
    reading: Reading = AS_STATED  # of scene files

    @property
    def recipe(self) -> Recipe:
        """The default recipe with `steps` steps, and the steps of other parts in proportion."""
        same = {n: getattr(self, n) for n in ("seed", "rate", "order", "degree", "quality")}
        recipe = Recipe(**same)
        if self.steps is None:
            return recipe
        other = {
            name: round(getattr(recipe, name) * self.steps / recipe.steps)
            for name in ("distill_steps", "quantize_steps")
        }
        return replace(recipe, steps=self.steps, **other)


class Subject:
    """A scene file or a folder of photographs; all values are computed on demand.

    folder: for trained baselines
    """

    def __init__(self, path: str, protocol: Protocol, folder: Path):
        self.path, self.protocol, self.folder = path, protocol, folder
        self.name = Path(path).resolve().name
        self.photographed = os.path.isdir(path) or path.endswith(".json")  # transforms.json
        self.pictures: dict[str, np.ndarray] = {}

    @cached_property
    def photographs(self) -> tuple[tuple, tuple]:
        """Training and held-out targets."""
        return compression_run.photographs(self.path, self.protocol.scale, HELD_OUT)

    @cached_property
    def key(self) -> str:
        """Key of everything that the original, the targets and the views depend on."""
        protocol = self.protocol
        if self.photographed:
            made_from = [protocol.train_steps, protocol.seed, HELD_OUT, self.photographs]
        else:
            made_from = [protocol.views, protocol.view_size, protocol.seed, self.path_cameras]
            made_from += [protocol.beside] if self.path_cameras else []
            made_from += [np.asarray(getattr(self.scene, n), np.float64) for n in ARRAYS]
            made_from += ["antialiased"] if self.scene.antialiased else []
            made_from += [protocol.reading.near] if protocol.reading.near else []
        return f"{self.name} {digest(made_from)}"

    @cached_property
    def scene(self) -> Scene:
        """The original scene: from the file, or the baseline, which is trained once and kept."""
        if not self.photographed:
            return open_source(self.path, self.protocol.reading).scene
        place = self.folder / f"{self.name}-{digest(self.key)[:12]}"
        kept = Checkpoints(place, self.key)
        if not kept.last:
            protocol, begin = self.protocol, time.perf_counter()
            scene = compression_run.trained(
                self.path, self.photographs[0], protocol.train_steps, protocol.seed,
                place / "train", self.name,
            )  # fmt: skip
            scene = replace(scene, name=self.name)
            kept.save("original", "original", scene, time.perf_counter() - begin)
        return kept.load(kept.last)

    @property
    def ply_bytes(self) -> int:
        """Bytes of the original as float32 PLY with all attributes."""
        return ply_bytes(len(self.scene), self.scene.sh_degree)

    @cached_property
    def targets(self) -> tuple:
        """Training pictures for compression."""
        if self.photographed:
            return self.photographs[0]
        from splatcore.model.compress.teacher import teacher_targets  # needs PyTorch

        protocol = self.protocol
        return teacher_targets(
            self.scene, protocol.views, protocol.view_size, protocol.seed, self.path_cameras,
            protocol.beside, protocol.reading.near_plane,
        )  # fmt: skip

    @cached_property
    def path_cameras(self) -> list[Camera]:
        """Cameras of the file next to the scene; the training views follow their path."""
        file = camera_beside(self.path)
        return self.protocol.reading.seen(read_cameras(file)) if file else []

    @cached_property
    def views(self) -> tuple[Target, ...]:
        """Held-out views for evaluation; their image is None if the original is the truth."""
        if self.photographed:
            return self.photographs[1]
        source = open_source(self.path, self.protocol.reading)
        if self.path_cameras:
            cameras = self.path_cameras
        elif source.camera:
            cameras = [source.camera]
        else:
            seed = self.protocol.seed + OWN_SEED
            cameras = surrounding_views(source.gaussians, OWN_VIEWS, *self.protocol.size, seed)
        cameras = self.protocol.reading.seen(cameras)
        sized = [camera.resized(*self.protocol.size) for camera in cameras]
        return tuple(Target(camera, None, camera.name or str(k)) for k, camera in enumerate(sized))

    @cached_property
    def beside(self) -> dict[str, Target]:
        """Views off the path, by the names of `BESIDE`: held-out views, moved in turn.

        Empty without a path.
        """
        if self.photographed or not self.path_cameras:
            return {}
        cameras = [view.camera for view in self.views]
        there = views_beside(cameras, core_of(self.scene.gaussians()).middle)
        views = {name: moved[k % len(moved)] for k, (name, moved) in enumerate(there.items())}
        return {name: Target(view, None, f"{view.name} {name}") for name, view in views.items()}

    def truth(self, view: Target) -> np.ndarray:
        """The true picture [H, W, 3] of a view: the photograph, or a rendering of the original."""
        if view.image is not None:
            return view.image
        if view.name not in self.pictures:
            self.pictures[view.name] = render(self.scene.gaussians(), view.camera).pixels
        return self.pictures[view.name]


def find(names: list[str]) -> list[str]:
    """Find the paths of subjects, by default of SCENES.

    names: paths, generated scenes, or files of the folder SPLATCORE_SCENES
    Raises InputError for a missing file, a packed model or a name used twice.
    """
    place = scene_folder()
    if not names and not place.is_dir():
        raise InputError(f"{place}: no such folder; name a SCENE or set {VARIABLE}")
    found = []
    for name in names or SCENES:
        shared = place / name
        path = name if os.path.exists(name) or name in GENERATORS else str(shared)
        if path == str(shared) and not shared.exists():
            raise InputError(f"{name}: no such file or folder, here or in {place}")
        if is_packed(path):
            raise InputError(f"{name}: is a packed model; compression needs a scene")
        found.append(path)
    titles = [Path(path).resolve().name for path in found]
    if twice := [title for title in titles if titles.count(title) > 1]:
        raise InputError(f"{twice[0]}: two scenes have this name; results need distinct names")
    return found
