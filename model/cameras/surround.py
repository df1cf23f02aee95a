"""Cameras around or inside a scene that has no photographs."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from splatcore.model.cameras.view import INSIDE, NEAREST, Core, blocked, core_of, sensible_view
from splatcore.model.formats.file import input_error
from splatcore.spec.camera import SIZE_MAX, Camera, look_at
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.scene import Gaussians

ELEVATION = np.radians((4.0, 50.0))
"""Angles at which a view looks down on its target: from eye height to a bird's-eye view."""

DISTANCE = (0.35, 1.2)
"""Distances from the target in framing distances: from a close-up to a little more than the whole
core."""

FIELD_OF_VIEW = np.radians((40.0, 75.0))
"""Angles across the longer side of the image: from a standard lens to a wide one."""

AIM = 0.5  # targets are within this share of the core's half sides from its centre

WITHIN = 3
"""Every WITHIN-th candidate stands inside the core and looks across it: from the distances above, a
view looks into a room but not around in it."""

TILT = np.radians(25.0)  # largest angle up or down of a view from inside the core

ABOUT = 1.25
"""Matter within this many of the core's half sides belongs to the subject. The core omits 8 % at
either end, so an even box has 1/0.84 = 1.19 of its sides; the rest allows for the size of the
Gaussians."""

OPEN = 10
"""Percentile of the hidden share of the core's inside that counts as an open direction. The share
is 0 for a room with an open side, so that its walls count, and 1 for an object, whose own front
hides its inside."""

TRIES = 8  # candidates per view; if too few pass, those that fail the fewest rules fill up

CELLS = 80
"""Cells per side of the grid of free space; a wall is seldom thinner than a cell."""

SPREAD = 8  # points that represent a Gaussian in that grid; a large one covers many cells

HALF = np.log(2)
"""Area of matter over area of a cell, or of a view, above which more light is stopped than
passes."""

PROBE = 30_000  # Gaussians, picked evenly, that decide whether a view is blocked or sees little


def surrounding_views(
    gaussians: Gaussians, count: int, width: int, height: int, seed: int = 0
) -> list[Camera]:
    """Choose `count` cameras of `width`×`height` pixels that together see the scene; y points down.

    Candidates turn about the core of the scene (`model.cameras.view.core_of`) by the golden angle.
    Their elevation, distance, field of view and target follow quasirandom sequences (Roberts 2018,
    "The unreasonable effectiveness of quasirandom sequences"). Every third one stands inside the
    core and looks across it. A candidate is dropped if
    - no free path leads to it from the sensible view (it is inside an object);
    - more light is stopped than passes right in front of it, between it and the core, or at a wall
      between it and the core's inside;
    - it sees less than half the median number of Gaussians of its kind.
    If too few remain, those that fail the fewest rules fill up. The same arguments give the same
    cameras; other seeds give cameras in between.

    Raises InputError for a count below 1, a negative seed, a size out of range, and a scene without
    a visible Gaussian.
    """
    if count < 1:
        raise input_error("count", f"{count} is below 1")
    if seed < 0:
        raise input_error("seed", f"{seed} is below 0")
    for side, pixels in (("width", width), ("height", height)):
        if not 1 <= pixels <= SIZE_MAX:
            raise input_error(side, f"{pixels} is not in 1 … {SIZE_MAX}")
    visible = _visible(gaussians)
    core = core_of(visible)
    start = sensible_view(visible, width, height).position - core.middle
    tried = list(_candidates(core, TRIES * count, width, height, seed))
    faults = _faults(core, visible.factor[core.index], tried, start)
    chosen = np.sort(np.argsort(faults, kind="stable")[:count])
    views = [tried[index][0] for index in chosen]
    return [replace(view, name=f"around {number}") for number, view in enumerate(views)]


def _faults(
    core: Core, factor: np.ndarray, tried: list[tuple[Camera, np.ndarray]], start: np.ndarray
) -> np.ndarray:
    """Number of rules [M] that each view of `_candidates` fails; `start`: as for `_reached`."""
    step = max(-(-len(core.point) // PROBE), 1)
    point, area = core.point[::step], core.area[::step] * step
    eyes = np.array([camera.position for camera, _ in tried]) - core.middle
    within = np.arange(len(tried)) % WITHIN == WITHIN - 1
    reached = _reached(core, factor, eyes, start)
    faults = (~reached).astype(int)
    held = np.array([_held(point, camera, core.middle) for camera, _ in tried])
    for kind in (within, ~within):
        good = kind & reached if (kind & reached).any() else kind
        if good.any():
            faults += kind & (held < max(np.median(held[good]) / 2, 1))
    hidden = np.array([blocked(point, area, INSIDE * core.half, eye, 1.0) for eye in eyes])
    faults += ~within & (hidden > np.percentile(hidden[~within], OPEN) + 0.5)
    for index, (_, target) in enumerate(tried):
        eye, aim = eyes[index], target - core.middle
        faults[index] += blocked(point - aim, area, np.zeros(3), eye - aim, 0.25) > 0.5
        if not within[index]:
            faults[index] += blocked(point, area, ABOUT * core.half, eye, 1.0) > 0.5
    return faults


def _visible(gaussians: Gaussians) -> Gaussians:
    """The Gaussians that can be seen at all, without their colours."""
    with np.errstate(invalid="ignore"):
        seen = gaussians.opacity >= ALPHA_MIN
    seen &= np.isfinite(gaussians.position).all(axis=1)
    seen &= np.isfinite(gaussians.factor).all(axis=(1, 2)) & np.isfinite(gaussians.opacity)
    if not seen.any():
        raise input_error("scene", "no Gaussian can be seen: all are transparent or not finite")
    arrays = (gaussians.position, gaussians.factor, gaussians.opacity)
    arrays = [array[seen] for array in arrays]
    return Gaussians(*arrays, np.empty((seen.sum(), 0, 3)), gaussians.antialiased)


def _candidates(
    core: Core, count: int, width: int, height: int, seed: int
) -> Iterator[tuple[Camera, np.ndarray]]:
    """Yield views spread evenly over directions, distances, fields of view and targets, each with
    its target [3] in world space."""
    dimensions = 7
    ratio = 2.0
    for _ in range(60):  # the root of x^(d+1) = x + 1, by iteration: the golden ratio of d numbers
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    shift = np.random.default_rng(seed).random(dimensions)
    index = np.arange(count)[:, None]
    even = (shift + index * ratio ** -np.arange(1.0, dimensions + 1)) % 1
    even[:, 0] = (shift[0] + index[:, 0] * (3 - np.sqrt(5)) / 2) % 1  # golden angle
    for number, (turn, rise, away, wide, *aim) in enumerate(even):
        azimuth = 2 * np.pi * turn
        elevation = ELEVATION[0] + rise * (ELEVATION[1] - ELEVATION[0])
        field_of_view = FIELD_OF_VIEW[0] + wide * (FIELD_OF_VIEW[1] - FIELD_OF_VIEW[0])
        focal = max(width, height) / (2 * np.tan(field_of_view / 2))
        if number % WITHIN == WITHIN - 1:
            eye = core.middle + core.half * (2 * np.array(aim) - 1)
            across = core.middle + AIM * core.half * np.sin([azimuth, 0, 2 * np.pi * away]) - eye
            azimuth = np.arctan2(-across[0], across[2])
            ahead = max(np.linalg.norm(core.half), NEAREST)
            target = eye - ahead * _direction(azimuth, (2 * rise - 1) * TILT)
            yield look_at(eye, target, width, height, focal), target
            continue
        share = DISTANCE[0] * (DISTANCE[1] / DISTANCE[0]) ** away
        distance = share * core.framing_distance(width, height, focal)
        target = core.middle + AIM * core.half * (2 * np.array(aim) - 1)
        eye = target + distance * _direction(azimuth, elevation)
        yield look_at(eye, target, width, height, focal), target


def _direction(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector [3] from a target to an eye; azimuth 0 is −z, up is −y."""
    level = np.cos(elevation)
    return np.array([level * np.sin(azimuth), -np.sin(elevation), -level * np.cos(azimuth)])


def _held(point: np.ndarray, camera: Camera, middle: np.ndarray) -> int:
    """Number of points [N, 3], relative to `middle`, that are inside the image."""
    x, y, z = ((point + middle) @ camera.rotation.T + camera.translation).T
    tan_x, tan_y = camera.tan_half_fov
    return int(np.sum((z > camera.near) & (np.abs(x) < tan_x * z) & (np.abs(y) < tan_y * z)))


def _reached(core: Core, factor: np.ndarray, eyes: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Mask [M] of the `eyes` [M, 3] that are connected to `start` [3] through free cells, which let
    more light pass than they stop; all positions are relative to the core's middle."""
    side = 1.05 * np.abs(np.vstack([eyes, start])).max()
    cell = 2 * side / CELLS
    rng = np.random.default_rng(0)
    offset = rng.standard_normal((len(factor), SPREAD, 3))
    place = core.point[:, None] + np.einsum("nij,nkj->nki", factor, offset)
    where = np.floor((place + side) / cell)
    inside = ((where >= 0) & (where < CELLS)).all(axis=2)
    shape = (CELLS,) * 3
    flat = np.ravel_multi_index(where[inside].astype(int).T, shape)
    weight = np.broadcast_to(core.area[:, None] / SPREAD, inside.shape)[inside]
    covered = np.bincount(flat, weight, CELLS**3).reshape(shape) / cell**2
    free = covered < HALF
    reached = np.zeros(shape, bool)
    reached[tuple(((start + side) / cell).astype(int))] = True
    grown = 0
    while (size := np.count_nonzero(reached)) > grown:
        grown = size
        for axis in range(3):
            ahead = np.moveaxis(reached, axis, 0)
            walk = np.moveaxis(free, axis, 0)
            ahead[1:] |= ahead[:-1] & walk[1:]
            ahead[:-1] |= ahead[1:] & walk[:-1]
    return reached[tuple(((eyes + side) / cell).astype(int).T)]


def perturbed(camera: Camera, distance: float, angle: float, rng: np.random.Generator) -> Camera:
    """The camera moved by up to `distance` scene units and turned by up to `angle` radians.

    The direction of the step and the axis of the turn are uniform on the sphere; step and turn are
    uniform up to their bounds. Intrinsics and name stay.
    """
    way, axis = rng.standard_normal((2, 3))
    way, axis = way / np.linalg.norm(way), axis / np.linalg.norm(axis)
    step, turn = rng.uniform(0, 1, 2) * (distance, angle)
    rotation = Rotation.from_rotvec(turn * axis).as_matrix() @ camera.rotation
    translation = -rotation @ (camera.position + step * way)
    return replace(camera, rotation=rotation, translation=translation)
