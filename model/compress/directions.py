"""From where views look at each Gaussian, and harmonics that are nearest as these views see them.

A Gaussian's colour is c + G·d in the direction d. Slopes G that are a little off are, on the mean
of its directions, made up for by c; what remains is what they are off about that mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatcore.model.compress.significance import view_weights
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

ELSEWHERE = 0.1
"""Variance of directions along each axis beyond that of the views: others may look, too."""

BLOCK = 1 << 16  # Gaussians whose distances to all entries are in memory at once


@dataclass(frozen=True, eq=False)
class Directions:
    """Of the unit vectors from cameras to each Gaussian, weighted by Σ alpha·T in each view."""

    mean: np.ndarray  # [N, 3]; 0 for what no view shows
    variance: np.ndarray  # [N, 3, 3], with ELSEWHERE

    def nearest(self, slopes: np.ndarray, entries: np.ndarray) -> np.ndarray:
        """For slopes G [N, 9], row by row, the index [N] of that of `entries` [K, 9] whose colours
        vary most alike: least Σ over the channels of (G − E)·variance·(G − E)."""
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

    def made_up(self, colours: np.ndarray, missing: np.ndarray) -> np.ndarray:
        """Colours [N, 3] that make up on the mean for the slopes [N, 9] that are missing."""
        return colours + (missing.reshape(-1, 3, 3) @ self.mean[:, :, None])[:, :, 0]


def directions_of(scene: Scene, cameras: Sequence[Camera]) -> Directions:
    """The directions in which the cameras look at the scene's Gaussians."""
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
