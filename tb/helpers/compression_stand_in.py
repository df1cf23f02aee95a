"""A stand-in for compression itself, for tests of all that is measured around it.

It has the signatures of `model.compress.compress` and `model.compress.train`, prunes and packs,
and never learns.
"""

import sys
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from splatcore.model.compress.checkpoint import Step, ply_bytes
from splatcore.model.formats.camera_file import cameras_json, read_cameras
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.compression import run as compression_run
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from tb.helpers.command import run

SIZE = "96x64"
COUNT = 600


@dataclass(frozen=True, eq=False)
class Target:
    """What compression learns from."""

    camera: Camera
    image: np.ndarray
    name: str


class Interrupt(BaseException):
    """What a user does."""


class StandIn:
    """`compress` and its neighbours by the same signatures; `calls` tells what was done."""

    def __init__(self):
        self.calls: list[str] = []
        self.stop_after: str | None = None
        self.breaks_at = 0  # Gaussians of the scene that cannot be compressed

    def teacher_targets(self, scene, count, size, seed, tell, cameras):
        self.calls.append(f"teacher {count} {size[0]}x{size[1]} {seed}, {len(cameras)} cameras")
        return (Target(generated_camera("garden"), np.zeros((2, 2, 3), np.uint8), "0"),)

    def train(self, photographs, points, steps, seed, folder, tell):
        self.calls.append(f"train {len(photographs)} {steps}")
        tell("training", 1, 1, 0.5)
        return small(300)

    def compress(self, scene, targets, recipe, checkpoints, config, tell, original):
        """Prunes evenly by the schedule, drops harmonics, packs."""
        assert len(targets)
        if len(scene) == self.breaks_at:
            raise FloatingPointError("the loss is NaN\nat step 7")
        self.calls.append(f"compress {len(scene)} {recipe.target_ratio}")
        size, rates = original, recipe.schedule
        if recipe.target_ratio:
            rest = len(pack(scene[:256], config)[0].image) - 256 * 22
            count = round((size / recipe.target_ratio - rest) / 22)
            if count < 20:
                raise InputError(f"--target-ratio {recipe.target_ratio:g}: cannot be reached")
            rates = (1 - min(count / len(scene), 1.0),)
        prunings = [("prune", "prune", 1 - rate) for rate in rates]
        plan = [("original", "original", 1.0), ("distill 1", "distill", 1.0)]
        place = 1 if recipe.order == "prune-first" else 2
        plan[place:place] = prunings
        for k, (name, kind, share) in enumerate(plan):
            tell(name, 0, 1, None if kind == "original" else 0.1)
            name = f"{name} ({k})" if kind == "prune" else name
            if not checkpoints.has(name):
                scene = scene[np.linspace(0, len(scene) - 1, round(share * len(scene))).astype(int)]
                scene = scene.with_sh_degree(1) if kind == "distill" else scene
                size = ply_bytes(len(scene), scene.sh_degree)
                loss = None if kind == "original" else 0.1
                checkpoints.save(
                    Step(name, kind, len(scene), scene.sh_degree, size, 0.5, loss), scene
                )
                self.calls.append(name)
            scene = checkpoints.scene(next(s for s in checkpoints.steps if s.name == name))
            if name == self.stop_after:
                raise Interrupt
        tell("quantize", 0, 1, None)
        model = pack(scene, config)[0]
        step = Step("quantize", "quantize", len(model), 1, len(model.image), 0.5, 0.2)
        return checkpoints.save(step, model=model)


def small(count: int = COUNT):
    """A garden that has harmonics of degree 3."""
    scene = generate("garden", count)
    sh = np.zeros((count, 16, 3))
    sh[:, : scene.sh.shape[1]] = scene.sh
    sh[:, 4:] = np.random.default_rng(0).normal(0, 0.02, (count, 12, 3))
    return replace(scene, sh=sh)


def installed(tmp_path, monkeypatch) -> StandIn:
    """The stand-in, in a working folder with a scene, a.ply, and two cameras."""
    monkeypatch.chdir(tmp_path)
    found, modules = StandIn(), {}
    for name, functions in {
        "compress": ("compress",),
        "teacher": ("teacher_targets",),
        "train": ("train",),
    }.items():
        module = modules[name] = ModuleType(f"splatcore.model.compress.{name}")
        for function in functions:
            setattr(module, function, getattr(found, function))
        monkeypatch.setitem(sys.modules, f"splatcore.model.compress.{name}", module)
    monkeypatch.setattr(compression_run, "check_installed", lambda: None)
    write_ply("a.ply", small())
    camera = generated_camera("garden", 192, 128)
    cameras = [replace(camera, name="left"), replace(camera, name="right", cx=camera.cx + 9)]
    (tmp_path / "a.cameras.json").write_text(cameras_json(cameras))
    return found


def bench(*arguments: str) -> int:
    return run("bench", "compression", "--out", "out", "--size", SIZE, *arguments)


def held_out() -> list[Camera]:
    return [camera.resized(96, 64) for camera in read_cameras("a.cameras.json")]
