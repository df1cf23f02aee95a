"""Training views of a scene: all around it, along the path of given cameras, or both."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.cameras.orbit import BESIDE, orbiting_views
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.cameras.view import core_of
from splatcore.spec.camera import Camera
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.scene import Gaussians

RISE, NEARER = np.radians(3.0), 1.05
"""Largest deviation of a view on the path of given cameras: elevation (radians) and factor of the
distance. A hand-held camera wavers by about as much."""

ASIDE = max(angle for angle, _ in BESIDE.values())
FARTHER = 1 / min(away for _, away in BESIDE.values())
"""Largest deviation of a view off the path, elevation and factor of the distance, from `BESIDE`."""


def teacher_views(
    gaussians: Gaussians,
    count: int,
    size: tuple[int, int],
    seed: int,
    cameras: Sequence[Camera] = (),
    beside: float = 0.0,
    near: float = NEAR_PLANE,
) -> list[Camera]:
    """Choose `count` training views.

    cameras: their path is followed, but no view coincides with one of them; without cameras the
        views surround the scene
    beside: share of the views that are off the path, 0 … 1
    near: near plane of surrounding views, scene units

    A few harmonics cannot be right from everywhere, so training views belong where the scene will
    be looked at. Off the path, far views are more frequent, because each has fewer neighbours.
    """
    if not cameras:
        views = surrounding_views(gaussians, count, *size, seed)
        return [replace(view, near=near) for view in views]
    given, middle = [camera.resized(*size) for camera in cameras], core_of(gaussians).middle
    off, views = round(beside * count), []
    if count != off:
        views += orbiting_views(given, middle, count - off, RISE, NEARER, seed)
    if off:
        views += orbiting_views(given, middle, off, ASIDE, FARTHER, seed, outward=True)
    return views


def capture_views(
    gaussians: Gaussians,
    count: int,
    size: tuple[int, int],
    seed: int,
    cameras: Sequence[Camera] = (),
    share: float = 0.5,
) -> list[Camera]:
    """Choose `count` views: a share on the path of `cameras`, the others around the scene.

    Without cameras, all views are around the scene. Names are `around-000` … and `path-000` …, so
    that file names sort in the order of the views.
    """
    on_path = round(share * count) if cameras else 0
    parts = {"around": (count - on_path, ()), "path": (on_path, cameras)}
    views = []
    for name, (number, given) in parts.items():
        found = teacher_views(gaussians, number, size, seed, given) if number else []
        digits = max(len(str(number - 1)), 3)
        views += [replace(view, name=f"{name}-{k:0{digits}}") for k, view in enumerate(found)]
    return views
