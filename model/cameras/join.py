"""Several scenes side by side in front of one camera, joined to one large scene."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.cameras.view import NEAREST, core_of
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene, joined

View = tuple[Scene, Camera]


def side_by_side(
    views: Sequence[View], behind: Scene | None = None, count: int | None = None
) -> View:
    """Join scenes so that one camera, the first scene's, sees them side by side.

    Scenes are moved, never turned or scaled, so rotations and harmonics stay unchanged. Each scene
    gets a column of the image, in order: the middle of its core (`core_of`) is moved to the middle
    of the column, √n times as far away as from its own camera, so that n scenes share the image's
    area. Scenes may reach into other columns; nearer Gaussians hide farther ones.

    views: scenes, each with its own camera
    behind: a scene that is moved behind the camera as a whole; it is loaded but never seen
    count: Gaussians to keep, picked evenly in storage order; Gaussians of `behind` go first

    Raises InputError if only some of the scenes in view are antialiased, and for a count below 1
    or above the number of Gaussians.
    """
    _check_marks([scene for scene, _ in views])
    camera = views[0][1]
    farther = np.sqrt(len(views))
    parts = []
    for number, (scene, own) in enumerate(views):
        middle = core_of(scene.gaussians()).middle
        depth = max((own.rotation @ middle + own.translation)[2], NEAREST)
        depth *= farther * camera.fx / own.fx
        column = camera.width * (number + 0.5) / len(views)
        target = depth * np.array([(column - camera.cx) / camera.fx, 0, 1])  # in camera axes
        parts.append(_moved(scene, camera.position + camera.rotation.T @ target - middle))
    if behind:
        depth = depths(behind, camera)
        parts.append(_moved(behind, -camera.rotation[2] * depth[np.isfinite(depth)].max(initial=0)))
    _cut(parts, count, behind is not None)
    whole = replace(joined(parts), name="joined", notes=())
    return whole, replace(camera, name="joined")


def depths(scene: Scene, camera: Camera) -> np.ndarray:
    """Depths [N] of a scene's Gaussians in front of a camera."""
    return scene.position @ camera.rotation[2] + camera.translation[2]


def in_view(scene: Scene, camera: Camera) -> int:
    """Number of Gaussians whose centres are inside the image and beyond the near plane."""
    x, y, z = (scene.position @ camera.rotation.T + camera.translation).T
    with np.errstate(all="ignore"):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return int((inside & (z > camera.near)).sum())


def _check_marks(scenes: list[Scene]):
    """Raise InputError if some scenes are antialiased and others are not."""
    names = {scene.antialiased: scene.name for scene in scenes}
    if len(names) > 1:
        fault = f"{names[True]} is antialiased, {names[False]} is not"
        raise InputError(f"{fault}; choose --antialiased or --no-antialiased for all")


def _moved(scene: Scene, way: np.ndarray) -> Scene:
    return replace(scene, position=scene.position + way)


def _cut(parts: list[Scene], count: int | None, behind: bool):
    """Reduce the parts to `count` Gaussians in all; a last part behind the camera is cut first."""
    total = sum(map(len, parts))
    if count is None:
        return
    if not 1 <= count <= total:
        raise InputError(f"count: {count} is not in 1 … {total}, the Gaussians of all scenes")
    if behind:
        parts[-1] = _picked(parts[-1], max(len(parts[-1]) - (total - count), 0))
    ends = np.cumsum([0, *map(len, parts)])
    kept = ends * count // ends[-1] if ends[-1] > count else ends
    parts[:] = [_picked(part, n) for part, n in zip(parts, np.diff(kept), strict=True)]


def _picked(scene: Scene, count: int) -> Scene:
    """`count` Gaussians of a scene, picked evenly."""
    return scene[np.arange(count) * len(scene) // max(count, 1)]
