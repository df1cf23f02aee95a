"""Several scenes side by side in front of one camera: one large scene of small ones."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatcore.model.cameras.view import NEAREST, core_of
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import ARRAYS, Scene, sh_count

View = tuple[Scene, Camera]


def side_by_side(
    views: Sequence[View], behind: Scene | None = None, count: int | None = None
) -> View:
    """All Gaussians of scenes, moved so that one camera sees them beside each other.

    The camera is the first scene's. Scenes are moved, never turned or scaled, so that their
    rotations and harmonics stay as they are. The image has a column for each, in order: the middle
    of a scene's core (`core_of`) comes to the middle of its column, √n times as far away as it is
    from its own camera: so n scenes share the image's area. They reach into each other's columns;
    what is in front hides the rest. The scene is `antialiased` if all of them are.

    behind: a scene that is moved behind the camera as a whole: it is loaded and never seen.
    count: Gaussians that are left, as evenly picked as they are stored; first those of `behind` go.

    The mark of antialiasing is that of all scenes in view. Raises InputError for scenes of which
    some are antialiased, and for a count below 1 or above what there is.
    """
    first = views[0][0]
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
    degree = max(scene.sh_degree for scene in parts)
    parts = [_with_degree(scene, degree) for scene in parts]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS}
    joined = replace(first, **arrays, name="joined", notes=())
    return joined, replace(camera, name="joined")


def depths(scene: Scene, camera: Camera) -> np.ndarray:
    """Depths [N] of a scene's Gaussians in front of a camera."""
    return scene.position @ camera.rotation[2] + camera.translation[2]


def in_view(scene: Scene, camera: Camera) -> int:
    """Gaussians whose centres lie in the image, beyond the near plane."""
    x, y, z = (scene.position @ camera.rotation.T + camera.translation).T
    with np.errstate(all="ignore"):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return int((inside & (z > camera.near)).sum())


def _check_marks(scenes: list[Scene]):
    """InputError if some scenes are antialiased and others are not."""
    names = {scene.antialiased: scene.name for scene in scenes}
    if len(names) > 1:
        which = f"{names[True]} is antialiased, {names[False]} is not"
        raise InputError(f"{which}; choose --antialiased or --no-antialiased for all")


def _moved(scene: Scene, way: np.ndarray) -> Scene:
    return replace(scene, position=scene.position + way)


def _cut(parts: list[Scene], count: int | None, behind: bool):
    """Leave `count` Gaussians of all; if the last part is behind the camera it gives first."""
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
    """So many Gaussians of a scene, evenly picked."""
    return scene[np.arange(count) * len(scene) // max(count, 1)]


def _with_degree(scene: Scene, degree: int) -> Scene:
    """The scene with coefficients up to that degree, those that it lacks being 0."""
    missing = sh_count(degree) - scene.sh.shape[1]
    return replace(scene, sh=np.pad(scene.sh, ((0, 0), (0, missing), (0, 0))))
