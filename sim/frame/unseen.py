"""Notes about cameras that see nothing, have Gaussians before the near plane, or see so little that
the file's axes may be others than assumed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from splatcore.model.cameras.join import in_view
from splatcore.model.formats.spz_axes import PLY_AXES, matrix
from splatcore.sim.common import notes
from splatcore.spec.camera import Camera
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.scene import Scene

if TYPE_CHECKING:
    from splatcore.sim.frame.shot import Shot
    from splatcore.sim.frame.source import Source

FEW = 0.1
"""With PLY's axes a camera sees more than 1/FEW times as many Gaussians: a note suggests them."""

NEAREST = 0.01
"""The near plane of gsplat and most viewers (scene units)."""


def note_empty(shot: "Shot", counts: dict):
    """Add a note if a picture shows no Gaussian.

    counts: of the picture, with "visible" (reference) or "splats" (machine)
    """
    if counts.get("visible", counts.get("splats")):
        return
    source, camera = shot.source, shot.camera
    text = f"no Gaussian is visible from camera{_name(camera)} at {_point(camera.position)}"
    text = f"{text} with near plane {camera.near:g}{_extent(source)}"
    notes.add(f"{source.name}: {text}")


def near_note(source: "Source", cameras: Sequence[Camera]) -> str:
    """Return a note about the camera that would gain the most Gaussians with a near plane of
    `NEAREST`; empty if none would gain any."""
    counts = [before_near(source, camera) for camera in cameras]
    if not any(counts):
        return ""
    camera, count = cameras[int(np.argmax(counts))], max(counts)
    more = _likewise(sum(map(bool, counts)) - 1)
    s, are, them = ("", "is", "it") if count == 1 else ("s", "are", "them")
    known = ", as in 3DGS" if camera.near == NEAR_PLANE else ""
    return (
        f"camera{_name(camera)}: {count:,} Gaussian{s} between depth {NEAREST:g} and the near "
        f"plane at {camera.near:g} {are} not drawn{known}{more}; --near {NEAREST:g} draws {them}"
    )


def before_near(source: "Source", camera: Camera) -> int:
    """Count the Gaussians before a camera's near plane that a near plane of `NEAREST` shows."""
    from splatcore.golden.batches import in_batches
    from splatcore.golden.reference import project

    scene, model = source.scene, source.model

    def between(batch: slice) -> np.ndarray:
        position = model.decoded(batch).position if scene is None else scene.position[batch]
        with np.errstate(all="ignore"):
            depth = position @ camera.rotation[2] + camera.translation[2]
        return np.flatnonzero((depth > NEAREST) & (depth <= camera.near)) + batch.start

    index = np.concatenate(in_batches(between, len(source.drawn)))
    if not len(index):
        return 0
    some = source.drawn.decoded(index)
    return int(project(some, replace(camera, near=NEAREST))[1]["visible"])


def axes_note(scene: Scene, cameras: Sequence[Camera]) -> str:
    """Return a note about the first camera that would see more than 1/`FEW` times as many centres
    with PLY's axes instead of the assumed ones; empty if none. Free unless axes were assumed."""
    if not scene.assumed_axes:
        return ""
    other = replace(scene, position=scene.position @ matrix(scene.assumed_axes))
    counts = [(camera, in_view(scene, camera), in_view(other, camera)) for camera in cameras]
    found = [(camera, here, there) for camera, here, there in counts if here < FEW * there]
    if not found:
        return ""
    camera, here, there = found[0]
    where = f"camera {camera.name}" if camera.name else "the camera"
    read = f"{here:,} Gaussians read as {scene.assumed_axes}, {there:,} as {PLY_AXES}"
    return f"{where} sees {read}{_likewise(len(found) - 1)}: try --axes {PLY_AXES.lower()}"


def _extent(source: "Source") -> str:
    """Return where most of a scene is, as text; empty without Gaussians."""
    position = source.position
    position = position[np.isfinite(position).all(1)]
    if not len(position):
        return ""
    low, high = (_point(np.percentile(position, percent, axis=0)) for percent in (1, 99))
    return f"; 98 % of the scene's Gaussians are between {low} and {high}"


def _point(place: np.ndarray) -> str:
    return f"({', '.join(f'{number:.4g}' for number in place)})"


def _likewise(count: int) -> str:
    """Return how many further cameras a note applies to, as text."""
    return f" ({count} other camera{'s' * (count > 1)} likewise)" if count else ""


def _name(camera: Camera) -> str:
    return f" {camera.name}" if camera.name else ""
