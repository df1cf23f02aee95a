"""Pruning: which Gaussians go, and by which steps."""

import numpy as np

from model.checkpoint import ply_bytes
from model.pack import keep
from spec.error import InputError
from spec.memory import ModelFormat
from spec.scene import Scene


def prune(scene: Scene, significance: np.ndarray, rate: float) -> Scene:
    """The scene without the share `rate` of its Gaussians that matter least; the others keep their
    order. What no view shows has significance 0 and goes first."""
    going = round(rate * len(scene))
    order = np.argsort(significance, kind="stable")
    return scene[np.sort(order[going:])]


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
