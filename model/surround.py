"""Cameras around, or inside, a scene for which there are no photographs."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from model.file import input_error
from model.view import INSIDE, Core, blocked, core_of, sensible_view
from spec.camera import Camera, look_at
from spec.convention import ALPHA_MIN, NEAR_PLANE
from spec.scene import Gaussians

ELEVATION = np.radians((4.0, 50.0))
"""Angles at which a view looks down on its target: from eye height to a bird's."""

DISTANCE = (0.35, 1.2)
"""Distances from the target in framing distances: from a close-up to a little more than all."""

FIELD_OF_VIEW = np.radians((40.0, 75.0))
"""Angles across the longer side of the image: from a standard lens to a wide one."""

AIM = 0.5
"""Share of the core's half sides about its centre within which a view's target lies."""

TRIES = 8
"""Views that are tried for each that is wanted; where fewer pass, the least bad make up."""

CELLS = 80
"""Cells along a side of the grid in which one walks; a wall is seldom thinner than a cell."""

SPREAD = 8
"""Points that stand for a Gaussian in that grid; a large one covers many cells."""

HALF = np.log(2)
"""Area of matter over area of a cell, or of a view, from which more light stops than passes."""

PROBE = 30_000
"""Gaussians that decide whether a view sees little or is blocked, evenly picked."""


def surrounding_views(
    gaussians: Gaussians, count: int, width: int, height: int, seed: int = 0
) -> list[Camera]:
    """`count` cameras of `width`×`height` pixels that together see the scene; y points down.

    Rule: views turn about the core of the scene (`model.view.core_of`) by the golden angle, their
    elevation, distance, field of view and target go by sequences as even (Roberts 2018, "The
    unreasonable effectiveness of quasirandom sequences"). A view is left out where one could not
    walk from the sensible view without going through matter (the back of a room's wall, the
    inside of an object); where matter right before it or between it and the core's inside stops
    more light than passes; and where it holds less than half the Gaussians that views hold at the
    median. Where too few are left the ones that fail fewest of these fill up. The same arguments
    give the same cameras; another seed gives others in between.

    Raises InputError for a count below 1, a negative seed, a size out of range, and for a scene
    in which no Gaussian can be seen.
    """
    if count < 1:
        raise input_error("count", f"{count} is not ≥ 1")
    if seed < 0:
        raise input_error("seed", f"{seed} is not ≥ 0")
    core = _visible_core(gaussians)
    probe = slice(None, None, max(-(-len(core.point) // PROBE), 1))
    step = len(core.point) / len(core.point[probe])
    point, area = core.point[probe], core.area[probe] * step
    cameras = list(_candidates(core, TRIES * count, width, height, seed))
    eyes = np.array([camera.position for camera in cameras]) - core.middle
    start = sensible_view(gaussians, width, height).position - core.middle
    faults = (~_reached(core, gaussians.factor[core.index], eyes, start)).astype(int)
    held = np.array([_held(point, camera, core.middle) for camera in cameras])
    faults += held < np.median(held[faults == 0] if (faults == 0).any() else held) / 2
    for index, eye in enumerate(eyes):
        hidden = blocked(point, area, INSIDE * core.half, eye, 1.0)
        right_before = blocked(point, area, np.zeros(3), eye, 0.25)
        faults[index] += (hidden > 0.5) + (right_before > 0.5)
    chosen = np.argsort(faults, kind="stable")[:count]
    return [
        replace(cameras[index], name=f"around {number}")
        for number, index in enumerate(np.sort(chosen))
    ]


def _visible_core(gaussians: Gaussians) -> Core:
    """The core of what can be seen at all."""
    with np.errstate(invalid="ignore"):
        seen = np.flatnonzero(gaussians.opacity >= ALPHA_MIN)
    visible = Gaussians(
        gaussians.position[seen], gaussians.factor[seen], gaussians.opacity[seen], gaussians.sh[:0]
    )
    core = core_of(visible)
    if not len(core.point):
        raise input_error("scene", "no Gaussian can be seen: all are transparent or not finite")
    return replace(core, index=seen[core.index])


def _candidates(core: Core, count: int, width: int, height: int, seed: int) -> Iterator[Camera]:
    """Views spread evenly over directions, distances, fields of view and targets."""
    dimensions = 7
    ratio = 2.0
    for _ in range(60):  # the root of x^(d+1) = x + 1, by iteration: the golden ratio of d numbers
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    shift = np.random.default_rng(seed).random(dimensions)
    index = np.arange(count)[:, None]
    even = (shift + index * ratio ** -np.arange(1.0, dimensions + 1)) % 1
    even[:, 0] = (shift[0] + index[:, 0] * (3 - np.sqrt(5)) / 2) % 1  # golden angle
    for turn, rise, away, wide, *aim in even:
        azimuth = 2 * np.pi * turn
        elevation = ELEVATION[0] + rise * (ELEVATION[1] - ELEVATION[0])
        field_of_view = FIELD_OF_VIEW[0] + wide * (FIELD_OF_VIEW[1] - FIELD_OF_VIEW[0])
        focal = max(width, height) / (2 * np.tan(field_of_view / 2))
        share = DISTANCE[0] * (DISTANCE[1] / DISTANCE[0]) ** away
        distance = share * core.framing_distance(width, height, focal)
        level = np.cos(elevation)
        way = np.array([level * np.sin(azimuth), -np.sin(elevation), -level * np.cos(azimuth)])
        target = core.middle + AIM * core.half * (2 * np.array(aim) - 1)
        yield look_at(target + distance * way, target, width, height, focal)


def _held(point: np.ndarray, camera: Camera, middle: np.ndarray) -> int:
    """How many of `point` [N, 3], relative to `middle`, lie inside the image."""
    x, y, z = ((point + middle) @ camera.rotation.T + camera.translation).T
    tan_x, tan_y = camera.tan_half_fov
    return int(np.sum((z > NEAR_PLANE) & (np.abs(x) < tan_x * z) & (np.abs(y) < tan_y * z)))


def _reached(core: Core, factor: np.ndarray, eyes: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Which of `eyes` [M, 3] one can walk to from `start` [3] through cells that let more light
    pass than they stop, [M] bool; all relative to the core's middle."""
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

    Direction of the step and axis of the turn are uniform on the sphere, step and turn uniform up
    to their bounds; intrinsics and name stay.
    """
    way, axis = rng.standard_normal((2, 3))
    way, axis = way / np.linalg.norm(way), axis / np.linalg.norm(axis)
    step, turn = rng.uniform(0, 1, 2) * (distance, angle)
    cross = np.cross(np.eye(3), axis)
    rotation = np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross  # Rodrigues
    rotation = rotation @ camera.rotation
    return replace(
        camera, rotation=rotation, translation=-rotation @ (camera.position + step * way)
    )
