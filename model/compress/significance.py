"""Views of the Gaussians: the significance of each one, and the directions from which it is seen.

Significance is the contribution to the views, times a volume term. Source: Fan et al.,
"LightGaussian" (2024), section 3.2: the sum over views and pixels of opacity·T, and the volume
normalised by the 90th percentile and damped by an exponent.

A Gaussian's colour is c + G·d in the direction d. The constant c compensates for an error of the
slopes G at the mean direction; the error of G times the deviation from the mean remains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.gradients.finetune import Progress
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

VOLUME_PERCENTILE = 90.0  # percentile above which a larger volume counts no more
VOLUME_POWER = 0.1  # exponent of the volume

ELSEWHERE = 0.1
"""Variance that is added to the directions along each axis, because other views may follow."""

BLOCK = 1 << 16  # Gaussians whose distances to all entries are computed at once


def significance(
    scene: Scene, cameras: Sequence[Camera], progress: Progress | None = None, phase: str = ""
) -> np.ndarray:
    """Significance [N]: Σ alpha·T over views and pixels, times the volume term.

    progress: called with the number of finished cameras, and of all
    phase: begins the name for `progress`
    Returns 0 for Gaussians that no view shows.
    """
    total = np.zeros(len(scene))
    for number, weight in enumerate(blending_weights(scene.gaussians(), cameras)):
        total += weight
        if progress:
            progress(f"{phase}: weighing Gaussians", number + 1, len(cameras), None)
    volume = scene.scale.prod(axis=1)
    large = np.percentile(volume, VOLUME_PERCENTILE) if len(volume) else 0.0
    if large > 0:
        total *= np.minimum(volume / large, 1) ** VOLUME_POWER
    return total


@dataclass(frozen=True, eq=False)
class Directions:
    """Mean and variance of the unit vectors from cameras to each Gaussian, weighted by its
    Σ alpha·T in each view."""

    mean: np.ndarray  # [N, 3]; 0 for Gaussians that no view shows
    variance: np.ndarray  # [N, 3, 3], including ELSEWHERE

    def nearest(self, slopes: np.ndarray, entries: np.ndarray) -> np.ndarray:
        """Indices [N] of the entries E [K, 9] nearest to slopes G [N, 9] (row by row), by the sum
        over the channels of (G − E)·variance·(G − E)."""
        rows = entries.reshape(-1, 3, 3)
        squares = np.einsum("kci,kcj->ijk", rows, rows).reshape(9, -1)
        found = np.empty(len(slopes), np.int64)
        for start in range(0, len(slopes), BLOCK):
            some = slice(start, start + BLOCK)
            variance = self.variance[some]
            turned = slopes[some].reshape(-1, 3, 3) @ variance
            distance = variance.reshape(-1, 9) @ squares - 2 * turned.reshape(-1, 9) @ entries.T
            found[some] = distance.argmin(axis=1)
        return found

    def compensated(self, colours: np.ndarray, missing: np.ndarray) -> np.ndarray:
        """Colours [N, 3] that compensate, at the mean direction, for missing slopes [N, 9]."""
        return colours + (missing.reshape(-1, 3, 3) @ self.mean[:, :, None])[:, :, 0]


def directions_of(scene: Scene, cameras: Sequence[Camera]) -> Directions:
    """The directions from which the cameras look at the scene's Gaussians."""
    tiny = float(np.finfo(np.float32).tiny)
    total = np.full(len(scene), tiny)
    mean, square = np.zeros((len(scene), 3)), np.zeros((len(scene), 3, 3))
    for camera, weight in zip(cameras, blending_weights(scene.gaussians(), cameras), strict=True):
        ray = scene.position - camera.position
        length = np.linalg.norm(ray, axis=1, keepdims=True)  # 0 for a Gaussian in a camera
        ray /= np.maximum(length, tiny)
        total += weight
        mean += weight[:, None] * ray
        square += weight[:, None, None] * ray[:, :, None] * ray[:, None]
    mean /= total[:, None]
    variance = square / total[:, None, None] - mean[:, :, None] * mean[:, None]
    return Directions(mean, variance + ELSEWHERE * np.eye(3))
