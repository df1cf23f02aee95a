"""Directions from which views look at each Gaussian, and the nearest harmonics as seen from there.

A Gaussian's colour is c + G·d in the direction d. The constant c compensates for an error of the
slopes G at the mean direction; the error of G times the deviation from the mean remains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.model.compress.significance import view_weights
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

ELSEWHERE = 0.1
"""Variance that is added to the directions along each axis, because other views may follow."""

BLOCK = 1 << 16  # Gaussians whose distances to all entries are computed at once


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
    for camera, weight in zip(cameras, view_weights(scene, cameras), strict=True):
        ray = scene.position - camera.position
        length = np.linalg.norm(ray, axis=1, keepdims=True)  # 0 for a Gaussian in a camera
        ray /= np.maximum(length, tiny)
        total += weight
        mean += weight[:, None] * ray
        square += weight[:, None, None] * ray[:, :, None] * ray[:, None]
    mean /= total[:, None]
    variance = square / total[:, None, None] - mean[:, :, None] * mean[:, None]
    return Directions(mean, variance + ELSEWHERE * np.eye(3))
