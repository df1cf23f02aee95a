"""A stand-in for compression, for tests of its benchmark.

It has the signatures of `model.compress.compress` and `model.compress.train`, prunes and packs,
but does not train.
"""

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np

from splatcore.model.formats.camera_file import cameras_json, read_cameras
from splatcore.model.formats.photographs import Target
from splatcore.model.formats.ply import write_ply
from splatcore.model.generate.generate import generated_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene
from splatcore.study.compression import run as compression_run
from tb.helpers.command import load, run
from tb.helpers.compression_scene import garden_with_harmonics

BENCH = "bench compression --out out --size 96x64"
COUNT = 600


class Interrupt(BaseException):
    """A user's Ctrl-C."""


class StandIn:
    """`compress` and related functions with the same signatures; `calls` is a log."""

    def __init__(self):
        self.calls: list[str] = []
        self.stop_after: str | None = None
        self.breaks_at = 0  # number of Gaussians of the scene for which compression fails

    def teacher_targets(self, scene, count, size, seed, cameras=(), beside=0.0, near=0.2):
        assert {camera.near for camera in cameras} <= {near}
        self.calls.append(
            f"teacher {count} {size[0]}x{size[1]} {seed}, {len(cameras)} cameras, {beside:g} beside"
        )
        return (Target(generated_camera("garden"), np.zeros((2, 2, 3), np.uint8), "0"),)

    def train(self, photographs, points, steps, seed, folder, progress, antialiased):
        self.calls.append(f"train {len(photographs)} {steps}")
        progress("training", 1, 1, 0.5)
        return small(300)

    def decide(self, scene, targets, recipe, *_):
        """Compact models, of degree 1 by default."""
        return recipe if recipe.degree is not None else replace(recipe, degree=1)

    def compress(self, scene, targets, recipe, checkpoints, config, progress, original):
        """Prunes evenly by the schedule, drops harmonics, packs as the recipe says."""
        assert len(targets)
        if len(scene) == self.breaks_at:
            raise FloatingPointError("the loss is NaN\nat step 7")
        self.calls.append(f"compress {len(scene)} {recipe.target_ratio}")
        size, rates = original, recipe.schedule
        if recipe.target_ratio:
            each = 38 if recipe.in_steps else 22
            packed = pack(scene[:256], config, **recipe.packing)[0]
            rest = len(packed.image) - 256 * each
            count = round((size / recipe.target_ratio - rest) / each)
            if count < 20:
                raise InputError(f"--target-ratio {recipe.target_ratio:g}: cannot be reached")
            rates = (1 - min(count / len(scene), 1.0),)
        degree = recipe.highest
        plan = [("original", "original", 1.0), (f"distill {degree}", "distill", 1.0)]
        place = 1 if recipe.order == "prune-first" else 2
        plan[place:place] = [("prune", "prune", 1 - rate) for rate in rates]
        for k, (name, kind, share) in enumerate(plan):
            loss = None if kind == "original" else 0.1
            progress(name, 0, 1, loss)
            name = f"{name} ({k})" if kind == "prune" else name
            if not checkpoints.find(name):
                scene = scene[np.linspace(0, len(scene) - 1, round(share * len(scene))).astype(int)]
                scene = scene.with_sh_degree(degree) if kind == "distill" else scene
                checkpoints.save(name, kind, scene, 0.5, loss)
                self.calls.append(name)
            yield checkpoints.find(name)
            scene = checkpoints.load(checkpoints.find(name))
            if name == self.stop_after:
                raise Interrupt
        progress("quantize", 0, 1, None)
        yield checkpoints.save(
            "quantize", "quantize", pack(scene, config, **recipe.packing)[0], 0.5, 0.2
        )


def small(count: int = COUNT) -> Scene:
    """A scene to compress, with harmonics of degree 3."""
    return garden_with_harmonics(count, 0.02, 0)


def installed(tmp_path, monkeypatch) -> StandIn:
    """Install the stand-in, and change to a folder with a scene, a.ply, and two cameras."""
    monkeypatch.chdir(tmp_path)
    found = StandIn()
    for name, function in (
        ("compress", "compress"), ("teacher", "teacher_targets"), ("train", "train"),
    ):  # fmt: skip
        module = ModuleType(f"splatcore.model.compress.{name}")
        setattr(module, function, getattr(found, function))
        module.decide = found.decide
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(compression_run, "check_installed", lambda: None)
    write_ply("a.ply", small())
    camera = generated_camera("garden", 192, 128)
    cameras = [replace(camera, name="left"), replace(camera, name="right", cx=camera.cx + 9)]
    (tmp_path / "a.cameras.json").write_text(cameras_json(cameras))
    return found


def bench(*arguments: str) -> int:
    """Run the command; its exit status."""
    return run(*BENCH.split(), *arguments)


def scenes() -> dict:
    """Results of the measured scenes, by name."""
    return load(Path("out/compression.json"))["scenes"]


def held_out() -> list[Camera]:
    return [camera.resized(96, 64) for camera in read_cameras("a.cameras.json")]
