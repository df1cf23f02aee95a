"""Floaters: the few Gaussians that training left far outside the scene.

One floater in a chunk coarsens the positions of the 255 others, and on the model's grid the
positions of all Gaussians. So floaters are stored in chunks of their own. The farthest are moved
nearer and shrunk in proportion, so that they look the same from within the scene.
"""

from dataclasses import dataclass

import numpy as np

from splatcore.spec.scene import batches

FEWEST = 16  # smaller scenes have no floaters

SHARE = 32
"""At most one in SHARE Gaussians is a floater (two in a small scene); more belong to the scene."""

GAP = 2.5
"""Floaters begin where a distance exceeds GAP times the next smaller one: the span of their chunk
would grow by as much."""

FAR = 8.0
"""Or where the distance exceeds FAR times that of the innermost candidate (one in SHARE)."""

RESERVE_BITS = 14
"""Bits by which floaters may coarsen the grid: 24 bits remain, as in a float32."""

PARALLAX = 256.0
"""Floaters are moved within PARALLAX · √(distance of the nearest floater · size of the scene): seen
from the scene, the shift is as small an angle as the offsets' step at the nearest floater."""

ALIKE = 16.0
"""Floaters within ALIKE times the distance of the nearest one are not moved: 16 bits suffice."""


@dataclass(frozen=True, eq=False)
class Floaters:
    """Floaters of a scene, the nearest first."""

    index: np.ndarray  # [F] indices of the Gaussians
    position: np.ndarray  # [F, 3] stored positions, scene units
    share: np.ndarray  # [F] stored distance from the scene's middle over original one; 1: not moved


def find_floaters(position: np.ndarray, largest: float = np.inf) -> Floaters:
    """Find the floaters among finite positions [N, 3], scene units.

    largest: limit on the magnitude of a stored coordinate, scene units

    Distances are measured from the coordinate-wise median; the largest of the three axes counts.
    """
    most = max(2, len(position) // SHARE)
    index = np.zeros(0, np.int64)
    if len(position) >= FEWEST:
        middle = np.array([np.median(column) for column in position.T])
        distance = np.empty(len(position))
        for rows in batches(len(position)):
            distance[rows] = np.abs(position[rows] - middle).max(1)
        outer = np.argpartition(distance, -most - 1)[-most - 1 :]
        outer = outer[np.argsort(distance[outer], kind="stable")]
        own = distance[outer]
        starts = (own[1:] > GAP * own[:-1]) | (own[1:] > FAR * own[0])
        index = outer[1 + starts.argmax() :] if starts.any() else index
    if not len(index):
        return Floaters(index, position[index], np.ones(0))
    far = distance[index]
    grid = np.ldexp(1.0, bound_exponent(np.delete(position, index, axis=0)) + RESERVE_BITS)
    bound = max(PARALLAX * np.sqrt(far[0] * own[0]), ALIKE * far[0])
    bound = min(bound, min(grid, largest) - np.abs(middle).max())
    share = np.minimum(bound / far, 1.0)
    nearer = middle + (position[index] - middle) * share[:, None]
    return Floaters(index, np.where((share < 1)[:, None], nearer, position[index]), share)


def bound_exponent(position: np.ndarray) -> int:
    """The smallest exponent e with all coordinates of positions [N, 3] below 2^e."""
    largest = max(position.max(initial=0), -position.min(initial=0))
    return int(np.frexp(largest)[1])
