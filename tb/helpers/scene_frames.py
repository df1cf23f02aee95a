"""Frames of scenes as input of binning."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import pytest

from splatcore.golden.points import project_points
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.config import DEFAULT
from tb.helpers.bin_frames import Frame
from tb.helpers.scenes import GAUSSIANS, REAL, scene_path

COUNT = 30_000  # Gaussians taken evenly from each real scene, approximately

SCENES = ("flowers.spz", "skull.sog", "kitchen.spz")

POINT_SCENES = (
    "flowers.spz", "skull.sog", "luma-seal.splat", "playbot.spz", "guitar.compressed.ply",
    "st-peter.sog", "kitchen.spz",
)  # fmt: skip
"""Real scenes with 20,000 Gaussians or more."""


SLOW = (*REAL, pytest.mark.slow)  # marks of a real scene


def parameters(names: Sequence[str], first: int = 3) -> list:
    """Parameters of a test: real scenes; all after the `first` ones only for `make verify`."""
    marks = [SLOW] * first + [(*SLOW, pytest.mark.verify)] * (len(names) - first)
    return [pytest.param(name, marks=mark) for name, mark in zip(names, marks, strict=True)]


def with_counts(names: Sequence[str]) -> list:
    """Parameters: the garden; a part of each real scene; for `make verify` also whole scenes."""
    parts = [pytest.param(name, COUNT, marks=SLOW) for name in names]
    whole = [pytest.param(name, None, marks=(*SLOW, pytest.mark.verify)) for name in names]
    return [("garden", None), *parts, *whole]


@cache
def scene_frame(name: str, count: int | None = COUNT, marked: bool = True) -> tuple:
    """A scene's frame with about `count` Gaussians (None: all), its model, camera and points.

    marked: keep the file's mark of opacity compensation
    """
    if name in GAUSSIANS:
        scene = read_scene(scene_path(name))
        camera = read_camera(f"{scene_path(name.split('.')[0] + '.cameras.json')}:0")
    else:
        scene, camera = generate(name), generated_camera(name)
    scene = replace(scene, antialiased=scene.antialiased and marked)
    model, _ = pack(scene[:: max(1, len(scene) // count) if count else 1], sh_degree=1)
    points = project_points(DEFAULT, model, camera)
    codes = points.codes
    return Frame(codes, camera.width, camera.height), model, camera, points
