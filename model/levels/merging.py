"""Merging pairs of Gaussians within groups, until each group has its number."""

from dataclasses import replace

import numpy as np
from numba import njit

from splatcore.model.compress.prune import NEIGHBOURS, area, costs, merge, pairs, replaced
from splatcore.spec.convention import ALPHA_MAX
from splatcore.spec.scene import Scene

ROUND = 4  # a round merges at most one in so many Gaussians of a group

LIGHT = 1e-12
"""Minimum weight, over the largest: moments need one, even of Gaussians of size 0."""

FILL = 2.0
"""Factor of the distances between parts in a merged Gaussian's covariance: gaps between Gaussians
are seen more than blur (docs/notes/2026-11-levels.md)."""

COLOUR = 12.0
"""Weight of colours in the cost of a pair: more than in pruning, which merges less."""

PERCENTILE = 95.0
"""The error of a group is this percentile of its Gaussians' displacements …"""

SHARE = 1 / 3
"""… times this, so that an error of a pixel is about one that can be seen: a displaced Gaussian is
spread over its parts, and most of a picture remains (docs/notes/2026-11-levels.md)."""


def coarser(
    scene: Scene, weight: np.ndarray, group: np.ndarray, target: int
) -> tuple[Scene, np.ndarray, np.ndarray]:
    """Merge each group of Gaussians to `target` ones.

    weight: [N] ≥ 0
    group: [N] ascending, from 0; each group has more than `target` Gaussians

    Returns the Gaussians [G·target], group by group, their weights, and the error [G] of each
    group in scene units. A merged Gaussian's displacement is the root of the weighted mean square
    distance between its centre and those of the Gaussians in its place.
    """
    weight = np.maximum(weight, max(weight.max() * LIGHT, np.finfo(np.float32).tiny))
    moved = np.zeros(len(scene))  # weighted sum of squared distances
    scene = replace(scene, sh=scene.sh.astype(np.float64))
    count = int(group[-1]) + 1
    while len(scene) > count * target:
        size = np.bincount(group, minlength=count)
        room = np.minimum(size - target, -(-size // ROUND))
        first, second = cheapest_pairs(scene, weight, group, room)
        members, pair = np.concatenate([first, second]), np.tile(np.arange(len(first)), 2)
        parts = scene[members]
        one = merge(parts, weight[members], pair, len(first), FILL)
        one = replace(one, opacity=opacities(parts, pair, one))
        apart = ((parts.position - one.position[pair]) ** 2).sum(1)
        moved[first] = np.bincount(pair, weight[members] * apart + moved[members])
        weight[first] += weight[second]
        stays = np.ones(len(scene), bool)
        stays[second] = False
        scene = replaced(scene, first, one)[stays]
        weight, moved, group = weight[stays], moved[stays], group[stays]
    away = np.sqrt(moved / weight).reshape(count, target)
    return scene, weight, SHARE * np.percentile(away, PERCENTILE, axis=1)


def opacities(parts: Scene, group: np.ndarray, one: Scene) -> np.ndarray:
    """Opacities [G] of merged Gaussians: −ln(1 − opacity) times area is that of their parts."""
    depth = -np.log1p(-np.minimum(parts.opacity, ALPHA_MAX)) * area(parts.scale)
    room = np.maximum(area(one.scale), np.finfo(np.float64).tiny)
    return np.minimum(-np.expm1(-np.bincount(group, depth, len(one)) / room), ALPHA_MAX)


def cheapest_pairs(
    scene: Scene, weight: np.ndarray, group: np.ndarray, room: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Disjoint pairs of members of a group, the cheapest of each group, at most `room` [G] of it;
    in each pair, the heavier Gaussian comes first."""
    start = np.searchsorted(group, np.arange(len(room) + 1))
    near, square = nearest(scene.position, start, NEIGHBOURS)
    cost = np.where(near < 0, np.inf, costs(scene, weight, square, near, COLOUR))
    return pairs(cost, near, weight, group, room)


@njit(cache=True, nogil=True)
def nearest(position, start, count):
    """The `count` nearest members of the same group, nearest first, −1 for none, and their squared
    distances: [N, count] each. start: [G + 1] first Gaussian of each group."""
    near = np.full((len(position), count), -1, np.int64)
    square = np.full((len(position), count), np.inf)
    for g in range(len(start) - 1):
        for n in range(start[g], start[g + 1]):
            for k in range(start[g], start[g + 1]):
                x = position[n, 0] - position[k, 0]
                y = position[n, 1] - position[k, 1]
                z = position[n, 2] - position[k, 2]
                found = x * x + y * y + z * z
                if k == n or not found < square[n, count - 1]:
                    continue
                place = count - 1
                while place > 0 and square[n, place - 1] > found:
                    square[n, place], near[n, place] = square[n, place - 1], near[n, place - 1]
                    place -= 1
                square[n, place], near[n, place] = found, k
    return near, square
