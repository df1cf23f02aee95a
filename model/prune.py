"""Pruning: which Gaussians go, who takes in what they covered, and by which steps."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from sklearn.neighbors import NearestNeighbors

from model.checkpoint import ply_bytes
from model.pack import keep
from spec.convention import ALPHA_MAX
from spec.error import InputError
from spec.memory import ModelFormat
from spec.scene import Scene


def prune(scene: Scene, significance: np.ndarray, rate: float) -> Scene:
    """The scene without the share `rate` of its Gaussians that matter least; the others keep their
    order.

    What goes is not lost: the nearest Gaussian that stays takes it in, and becomes the one with
    the mean, the covariance and the mean colour of both, weighted by significance. What no view
    shows has significance 0, goes first, and leaves nothing.
    """
    going = np.argsort(significance, kind="stable")[: round(rate * len(scene))]
    stays = np.ones(len(scene), bool)
    stays[going] = False
    staying = np.flatnonzero(stays)
    seen = going[significance[going] > 0]
    if not len(seen) or not len(staying):
        return scene[staying]
    near = NearestNeighbors(n_neighbors=1).fit(scene.position[staying])
    heir = near.kneighbors(scene.position[seen])[1][:, 0]  # [seen] which of those that stay
    grown, group = np.unique(heir, return_inverse=True)
    members = np.concatenate([staying[grown], seen])
    group = np.concatenate([np.arange(len(grown)), group])
    merged = merge(scene[members], significance[members], group, len(grown))
    arrays = {}
    for name in ("position", "scale", "quaternion", "opacity", "sh"):
        arrays[name] = getattr(scene, name)[staying]
        arrays[name][grown] = getattr(merged, name)
    return replace(scene, **arrays)


def merge(scene: Scene, weight: np.ndarray, group: np.ndarray, count: int) -> Scene:
    """One Gaussian for each of `count` groups; `group` [N] says which one a Gaussian belongs to.

    Each has its group's moments, weighted by `weight` [N] > 0. Its opacity times area (of the two
    larger axes) is that of the first member, times what the group weighs more than that: with
    significance as weight, it gives the views what they all gave.
    """
    total = np.bincount(group, weight, count)

    def mean(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1).T
        sums = [np.bincount(group, weight * column, count) for column in flat]
        return (np.stack(sums, axis=1) / total[:, None]).reshape(count, *values.shape[1:])

    position = mean(scene.position)
    factor, away = scene.gaussians().factor, scene.position - position[group]
    spread = factor @ factor.swapaxes(1, 2) + away[:, :, None] * away[:, None]
    variance, axes = np.linalg.eigh(mean(spread))
    axes[np.linalg.det(axes) < 0, :, 0] *= -1
    scale = np.sqrt(np.maximum(variance, 0))
    quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    _, first = np.unique(group, return_index=True)
    covered = scene.opacity[first] * area(scene.scale[first]) * total / weight[first]
    room = np.maximum(area(scale), np.finfo(np.float64).tiny)
    opacity = np.minimum(covered / room, ALPHA_MAX)
    return Scene(position, scale, quaternion, opacity, mean(scene.sh), scene.name)


def area(scale: np.ndarray) -> np.ndarray:
    """Product [N] of the two larger axes of scales [N, 3]."""
    ordered = np.sort(scale, axis=1)
    return ordered[:, 1] * ordered[:, 2]


def sound(scene: Scene) -> Scene:
    """The scene without what is not finite or can never reach alpha 1/255."""
    with np.errstate(invalid="ignore"):
        finite, visible = keep(scene)
    kept = scene[finite & visible]
    if not len(kept):
        raise InputError(
            f"{scene.name}: no Gaussian can be seen: all are transparent or not finite"
        )
    return kept


def count_for_ratio(original: int, ratio: float, format: ModelFormat) -> int:
    """Gaussians of a packed model that is `ratio` times smaller than `original` bytes.

    InputError if the codebooks alone are larger.
    """
    room = original / ratio - format.layout(0).end
    low, high = 0, max(int(room), 0)
    while low < high:  # the largest count whose model fits
        middle = (low + high + 1) // 2
        low, high = (
            (middle, high) if format.layout(middle).end <= original / ratio else (low, middle - 1)
        )
    if low < 1:
        room = f"{ratio:g} leaves {original / ratio:.0f} bytes"
        least = format.layout(1).end
        raise InputError(f"--target-ratio: {room}, and a packed model has {least} at least")
    return low


def scaled_schedule(schedule: tuple[float, ...], count: int, target: int) -> tuple[float, ...]:
    """Rates in the proportions of `schedule` that leave `target` of `count` Gaussians.

    The logarithms of what each step leaves are scaled by one factor. Empty if nothing has to go.
    """
    if target >= count:
        return ()
    left = np.log1p(-np.asarray(schedule or (0.4,), np.float64))
    return tuple(float(rate) for rate in -np.expm1(left * np.log(target / count) / left.sum()))


def original_bytes(scene: Scene) -> int:
    """Size of the scene as a float32 PLY with all attributes of its degree."""
    return ply_bytes(len(scene), scene.sh_degree)
