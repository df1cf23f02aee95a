"""Views of a scene to learn from: all round, or on the path of given cameras, or some of each."""

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
"""Largest deviation of views from the path of given cameras: elevation, and factor of distance. A
hand that holds a camera wavers so."""

ASIDE = max(angle for angle, _ in BESIDE.values())
FARTHER = 1 / min(away for _, away in BESIDE.values())
"""Largest deviation of views beside the path: as far off, and as near, as `BESIDE` has them."""


def teacher_views(
    gaussians: Gaussians,
    count: int,
    size: tuple[int, int],
    seed: int,
    cameras: Sequence[Camera] = (),
    beside: float = 0.0,
    near: float = NEAR_PLANE,
) -> list[Camera]:
    """`count` views to learn from: from all round with that near plane, or on the path of `cameras`
    and never where one of them is, `beside` of them off it.

    Few harmonics cannot be right from everywhere: what is learned is best where the views are. Off
    the path more of them are far off, where a view has fewer others round it.
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
    """`count` views, `share` of them on the path of `cameras`, the others from all round; without
    cameras all of these.

    Their names, `around-000` and `path-000` onwards, sort as the views do.
    """
    on_path = round(share * count) if cameras else 0
    parts = {"around": (count - on_path, ()), "path": (on_path, cameras)}
    views = []
    for name, (number, given) in parts.items():
        found = teacher_views(gaussians, number, size, seed, given) if number else []
        digits = max(len(str(number - 1)), 3)
        views += [replace(view, name=f"{name}-{k:0{digits}}") for k, view in enumerate(found)]
    return views
