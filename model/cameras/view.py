"""A default camera for a scene file without cameras."""

from dataclasses import dataclass

import numpy as np

from splatcore.spec.camera import Camera, look_at
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.packed import Drawn
from splatcore.spec.scene import batches

FIELD_OF_VIEW = np.radians(55.0)  # angle across the longer side of the image
ELEVATION = np.radians(17.0)  # angle at which the camera looks down on its target

OPAQUE = 0.3
"""Smallest opacity of a Gaussian that counts, if at least a tenth of them reach it."""

SHELL_RATIO = 4.0  # Gaussians beyond this many median distances from the middle are sky or floaters
ROUNDS = 10  # maximum number of times that middle and median distance are recomputed
CORE = (8.0, 92.0)  # percentiles along x and z that bound the core of a scene

CORE_TALL = (2.0, 98.0)
"""Percentiles along y: objects on a wide ground hold few of the Gaussians."""

FILL = 0.85  # share of the image's half sides that the core takes up
NEAREST = 3 * NEAR_PLANE  # smallest distance of the camera from its target, scene units

NEAREST_SHARE = 2.0**-40
"""The same as a share of the target's coordinates, so that camera and target differ in float64."""

LARGEST = float(np.finfo(np.float32).max)  # larger positions and sizes do not count
DIRECTIONS = 24  # compass directions that are tried

CLOSER = {1.0: 0.0, 0.7: 0.35, 0.5: 0.55}
"""Shares of the distance that are tried → penalty for being that close."""

EDGEWISE = 0.5
"""Penalty for directions that see a narrow side, per share of the greatest breadth that is
missing."""

DETOUR = 0.1  # penalty for seeing the scene from half a turn away from −z

INSIDE = 0.75
"""Share of the core's sides within which matter is the subject; a room's walls are outside."""

WALLS = 0.25
"""Penalty for a direction in which walls hide the core's inside, seen from full distance."""

SAMPLE = 100_000  # Gaussians that are considered, picked evenly; more would not change the view


@dataclass(frozen=True, eq=False)
class Core:
    """The subject of a scene: a box, and the Gaussians in and near it that count."""

    middle: np.ndarray  # [3] centre of the box, scene units
    half: np.ndarray  # [3] its half sides
    index: np.ndarray  # [N] which Gaussians count
    point: np.ndarray  # [N, 3] their positions relative to `middle`
    area: np.ndarray  # [N] area that each represents, square scene units

    def framing_distance(self, width: int, height: int, focal: float) -> float:
        """Distance (scene units) at which the core fills an image; arguments in pixels."""
        half = self.half
        wide = 1.15 * half[[0, 2]].max() * 2 * focal / width
        tall = half[1] * np.cos(ELEVATION) + half[[0, 2]].max() * np.sin(ELEVATION)
        distance = max(wide, tall * 2 * focal / height) / FILL + half[[0, 2]].min() / 2
        return max(distance, NEAREST, NEAREST_SHARE * np.abs(self.middle).max())


def sensible_view(gaussians: Drawn, width: int, height: int) -> Camera:
    """Choose a camera that shows the subject of a scene; y points down.

    1. Only finite Gaussians of opacity ≥ 0.3 count (the more opaque half if fewer than a tenth
       have that opacity).
    2. Gaussians more than 4 median distances from the coordinate-wise median are dropped, and both
       medians recomputed until nothing changes: this removes sky shells and floaters.
    3. The core is the box between the 8th and 92nd percentile (2nd and 98th along y).
    4. The camera looks at its centre from 17° above, at the distance at which the core fills the
       image, at least 0.6 units.
    5. Of 24 compass directions and three distances (that one and two shorter), the view with the
       smallest penalty wins. Penalties: matter outside the core in front of it; walls that hide the
       core's inside; a narrow side of the core; a shorter distance; a detour from −z.

    A scene in which no Gaussian counts is seen like a point at the origin.
    """
    core = core_of(gaussians)
    focal = max(width, height) / (2 * np.tan(FIELD_OF_VIEW / 2))
    distance = core.framing_distance(width, height, focal)
    eye = _open_viewpoint(core.point, core.area, core.half, distance)
    return look_at(core.middle + eye, core.middle, width, height, focal, name="sensible")


def core_of(gaussians: Drawn) -> Core:
    """The core of a scene, by the rule of `sensible_view`; empty and at the origin if no Gaussian
    counts."""
    index, area = _solid(gaussians)
    position = gaussians.decoded(index).position
    for _ in range(ROUNDS if len(index) else 0):
        away = np.linalg.norm(position - np.median(position, axis=0), axis=1)
        near = away <= SHELL_RATIO * np.median(away)
        if near.all():
            break
        index, area, position = index[near], area[near], position[near]
    low, high = np.zeros((2, 3))
    if len(position):
        low, high = np.percentile(position, CORE, axis=0)
        low[1], high[1] = np.percentile(position[:, 1], CORE_TALL)
    middle = (low + high) / 2
    body = 3 * np.sqrt(np.median(area) / (2 * np.pi)) if len(area) else 0.0
    half = np.maximum((high - low) / 2, body)
    return Core(middle, half, index, position - middle, area)


def _solid(gaussians: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """Indices [N] of the Gaussians that count, and the area [N] that each represents: 2π · product
    of the two larger axes · opacity · number of Gaussians it was picked from."""
    found, opacities = [], []
    for batch in batches(len(gaussians)):
        some = gaussians.decoded(batch)
        opacity = some.opacity
        finite = (np.abs(some.position) <= LARGEST).all(axis=1) & np.isfinite(opacity)
        finite &= (np.abs(some.factor) <= LARGEST).all(axis=(1, 2))
        found.append(np.flatnonzero(finite) + batch.start)
        opacities.append(opacity[finite])
    index = np.concatenate([np.zeros(0, np.int64), *found])
    if len(index):
        opacity = np.concatenate(opacities)
        bound = OPAQUE if np.mean(opacity >= OPAQUE) >= 0.1 else np.median(opacity)
        index = index[opacity >= bound]
    step = max(-(-len(index) // SAMPLE), 1)
    index = index[::step]
    some = gaussians.decoded(index)
    axes = np.linalg.svd(some.factor, compute_uv=False)  # [N, 3], largest first
    area = 2 * np.pi * some.opacity * axes[:, 0] * axes[:, 1]
    return index, area * step


def _open_viewpoint(
    point: np.ndarray, area: np.ndarray, half: np.ndarray, distance: float
) -> np.ndarray:
    """The best position [3] of the camera, relative to the target, over all directions and
    distances.

    point: [N, 3] relative to the target
    area: [N] that each point represents, square scene units
    half: [3] the core's half sides, scene units
    distance: the largest distance, scene units
    """
    azimuth = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS  # 0 is −z
    sideways = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)  # the image's x, in (x, z)
    core = point[(np.abs(point) <= half).all(axis=1)][:, [0, 2]]
    breadth = np.std(core @ sideways.T, axis=0) if len(core) else np.ones(DIRECTIONS)
    missing = 1 - breadth / max(breadth.max(), np.finfo(float).tiny)
    level = np.cos(ELEVATION)
    down = np.full(DIRECTIONS, -np.sin(ELEVATION))
    ways = np.stack([level * np.sin(azimuth), down, -level * np.cos(azimuth)], axis=1)
    hidden = [blocked(point, area, INSIDE * half, distance * way, 1.0) for way in ways]
    best, choice = np.inf, None
    for share, handicap in CLOSER.items():
        for step, way in enumerate(ways):
            eye = max(share * distance, NEAREST) * way
            detour = 2 * min(step, DIRECTIONS - step) / DIRECTIONS
            score = round(blocked(point, area, half, eye, 0.8), 1) + handicap
            score += WALLS * round(hidden[step], 1)
            score += EDGEWISE * missing[step] + DETOUR * detour
            if score < best:
                best, choice = score, eye
    return choice


def blocked(
    point: np.ndarray, area: np.ndarray, half: np.ndarray, eye: np.ndarray, until: float
) -> float:
    """Share of the view, 0 … 1, that is hidden by matter outside the box ±`half` [3].

    The view is a cone from `eye` [3] that ends at the share `until` of the way to the target.
    """
    distance = np.linalg.norm(eye)
    if not distance:
        return 0.0  # the eye is at the target
    way = -eye / distance
    from_eye = point - eye
    depth = from_eye @ way
    aside = np.linalg.norm(from_eye - depth[:, None] * way, axis=1)
    outside = (np.abs(point) > half).any(axis=1)
    between = outside & (depth > -0.05 * distance) & (depth < until * distance)
    between &= aside < 0.04 * distance + 0.15 * np.abs(depth)
    spread = np.pi * (0.04 * distance + 0.15 * np.abs(depth[between])) ** 2
    return float(-np.expm1(-np.sum(area[between] / spread)))
