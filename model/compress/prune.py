"""Pruning: remove Gaussians that no view shows, then merge pairs of neighbours."""

from bisect import bisect_right
from dataclasses import replace

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation
from sklearn.neighbors import NearestNeighbors

from splatcore.model.pack.stored import keep
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import ALPHA_MAX, COLOUR_OFFSET
from splatcore.spec.error import InputError
from splatcore.spec.memory import ModelFormat
from splatcore.spec.scene import ARRAYS, Scene

NEIGHBOURS = 8  # a Gaussian may be merged with one of this many nearest Gaussians

COLOUR = 3.0
"""Cost of a squared difference of colours (0 … 1), over the cost of a squared distance in sizes."""

ALWAYS = 0.01
"""Minimum cost of a merger, in squared distances: merging equal Gaussians is not free either."""

ROUND = 0.15  # share of the Gaussians that is merged before all costs are recomputed


def prune(scene: Scene, significance: np.ndarray, rate: float) -> Scene:
    """Reduce the number of Gaussians by the share `rate`; the others keep their order.

    significance: [N], see `model.compress.significance`

    Gaussians that no view shows (significance 0) are removed first. Then pairs of neighbours are
    merged (`merge`), the cheapest first: with significances v and w, a pair costs v·w/(v + w) times
    its squared distance in sizes plus its weighted squared difference in colour. So pairs are cheap
    if one of them hardly matters, or if its neighbour can replace it.
    """
    return merged(scene, significance, rate)[0]


def merged(scene: Scene, significance: np.ndarray, rate: float) -> tuple[Scene, np.ndarray]:
    """The scene of `prune`, and the significances [M] of its Gaussians (sums, if merged)."""
    target = len(scene) - round(rate * len(scene))
    unseen = np.flatnonzero(significance <= 0)[: len(scene) - target]
    stays = np.ones(len(scene), bool)
    stays[unseen] = False
    scene, weight = scene[stays], np.asarray(significance, np.float64)[stays]
    while len(scene) > target and (weight > 0).all():
        most = min(len(scene) - target, max(round(ROUND * len(scene)), 1))
        first, second = cheapest_pairs(scene, weight, most)
        members = np.concatenate([first, second])
        group = np.tile(np.arange(len(first)), 2)
        one = merge(scene[members], weight[members], group, len(first))
        weight[first] += weight[second]
        stays = np.ones(len(scene), bool)
        stays[second] = False
        scene, weight = replaced(scene, first, one)[stays], weight[stays]
    return scene, weight


def cheapest_pairs(scene: Scene, weight: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """At most `most` disjoint pairs, cheapest first; in each, the heavier Gaussian comes first."""
    count = min(NEIGHBOURS, len(scene) - 1)
    search = NearestNeighbors(n_neighbors=count + 1).fit(scene.position)
    distance, near = (found[:, 1:] for found in search.kneighbors(scene.position))  # [N, count]
    cost = costs(scene, weight, distance**2, near)
    return pairs(cost, near, weight, np.zeros(len(scene), np.int64), np.array([most]))


def pairs(
    cost: np.ndarray, near: np.ndarray, weight: np.ndarray, group: np.ndarray, room: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Disjoint pairs, cheapest first; in each, the heavier Gaussian comes first.

    cost: [N, k] of merging a Gaussian with its neighbours `near` [N, k]
    group: [N] of the pairs' first Gaussians
    room: [G] maximum number of pairs of each group
    """
    rows, best = np.arange(len(cost)), cost.argmin(axis=1)
    partner = near[rows, best]
    order = np.argsort(cost[rows, best], kind="stable")
    one, other = disjoint(order, partner, group, room.copy())
    heavier = weight[one] >= weight[other]
    return np.where(heavier, one, other), np.where(heavier, other, one)


def costs(
    scene: Scene, weight: np.ndarray, square: np.ndarray, near: np.ndarray, colour: float = COLOUR
) -> np.ndarray:
    """Costs [N, k] of merging Gaussians with neighbours.

    square: [N, k] squared distances of the neighbours `near` [N, k]
    colour: weight of the colours' squared difference
    """
    size = np.maximum(area(scene.scale), np.finfo(np.float32).tiny)
    shown = np.clip(scene.sh[:, 0] * SH_C0 + COLOUR_OFFSET, 0, 1)
    apart = square / (size[:, None] + size[near])
    apart += colour * ((shown[:, None] - shown[near]) ** 2).sum(axis=2) + ALWAYS
    return apart * weight[:, None] * weight[near] / (weight[:, None] + weight[near])


@njit(cache=True, nogil=True)
def disjoint(order, partner, group, room):
    """The first pairs (n, partner[n]) in the order of n that share no member, as many per group as
    there is room, which is counted down."""
    used = np.zeros(len(partner), np.bool_)
    one, other = np.empty(len(order), np.int64), np.empty(len(order), np.int64)
    found = 0
    for n in order:
        if room[group[n]] > 0 and not used[n] and not used[partner[n]]:
            used[n] = used[partner[n]] = True
            room[group[n]] -= 1
            one[found], other[found] = n, partner[n]
            found += 1
    return one[:found], other[:found]


def replaced(scene: Scene, index: np.ndarray, by: Scene) -> Scene:
    """The scene with Gaussians `index` replaced by the Gaussians of another."""
    arrays = {}
    for name in ARRAYS:
        arrays[name] = np.array(getattr(scene, name), np.float64)
        arrays[name][index] = getattr(by, name)
    return replace(scene, **arrays)


def merge(
    scene: Scene, weight: np.ndarray, group: np.ndarray, count: int, fill: float = 1.0
) -> Scene:
    """Merge each of `count` groups to one Gaussian with the group's weighted moments.

    weight: [N] > 0
    group: [N] group of each Gaussian
    fill: factor of the part of the covariance that is due to distances between centres

    Opacity times area (of the two larger axes) is the first member's, scaled by the group's weight
    over that member's: with significance as weight, the merged Gaussian contributes as much to the
    views as the group did. Opacities are taken before compensation for the blur.
    """
    total = np.bincount(group, weight, count)

    def mean(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1).T
        sums = [np.bincount(group, weight * column, count) for column in flat]
        return (np.stack(sums, axis=1) / total[:, None]).reshape(count, *values.shape[1:])

    position = mean(scene.position)
    factor, away = scene.gaussians().factor, scene.position - position[group]
    spread = factor @ factor.swapaxes(1, 2) + fill * away[:, :, None] * away[:, None]
    variance, axes = np.linalg.eigh(mean(spread))
    axes[np.linalg.det(axes) < 0, :, 0] *= -1
    scale = np.sqrt(np.maximum(variance, 0))
    quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    _, first = np.unique(group, return_index=True)
    covered = scene.opacity[first] * area(scene.scale[first]) * total / weight[first]
    room = np.maximum(area(scale), np.finfo(np.float64).tiny)
    opacity = np.minimum(covered / room, ALPHA_MAX)
    arrays = position, scale, quaternion, opacity, mean(scene.sh)
    return replace(scene, **dict(zip(ARRAYS, arrays, strict=True)))


def area(scale: np.ndarray) -> np.ndarray:
    """Product [N] of the two larger axes of scales [N, 3]."""
    ordered = np.sort(scale, axis=1)
    return ordered[:, 1] * ordered[:, 2]


def sound(scene: Scene) -> Scene:
    """The scene without Gaussians that are not finite or can never reach alpha 1/255.

    Raises InputError if none remains.
    """
    with np.errstate(invalid="ignore"):
        finite, visible = keep(scene)
    kept = scene[finite & visible]
    if not len(kept):
        raise InputError(
            f"{scene.name}: no Gaussian can be seen: all are transparent or not finite"
        )
    return kept


def count_in(room: float, format: ModelFormat, beats: int = 0) -> int:
    """Number of Gaussians of the largest packed model of at most `room` bytes; 0 if none fits.

    beats: beats of harmonics per Gaussian
    """
    return bisect_right(
        range(1, int(room) + 1), room, key=lambda count: format.layout(count, beats * count).end
    )


def scaled_schedule(schedule: tuple[float, ...], count: int, target: int) -> tuple[float, ...]:
    """Pruning rates in the proportions of `schedule` that leave `target` of `count` Gaussians.

    The logarithm of each step's remaining share is scaled by one factor. Empty if nothing has to be
    pruned.
    """
    if target >= count:
        return ()
    left = np.log1p(-np.asarray(schedule or (0.4,), np.float64))
    return tuple(float(rate) for rate in -np.expm1(left * np.log(target / count) / left.sum()))
