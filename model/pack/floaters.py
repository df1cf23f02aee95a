"""Floaters: the few Gaussians that training left far outside of the scene.

One floater in a chunk coarsens the positions of the 255 others; on the model's grid it coarsens
those of all. So floaters are stored in chunks of their own. The farthest are brought nearer, with
their size, so that they look the same from within the scene.
"""

from dataclasses import dataclass

import numpy as np

FEWEST = 16  # Gaussians of a scene that has floaters

SHARE = 32
"""At most one of SHARE Gaussians is a floater, or two of a smaller scene; more are the scene."""

GAP = 2.5
"""Floaters begin where a distance is over GAP times the next smaller one: their chunk's span would
grow as much."""

FAR = 8.0
"""Or where it is over FAR times the distance within which all but one of SHARE are."""

RESERVE_BITS = 14
"""How much coarser floaters may make the grid: 24 bits are left, those of a float32."""

PARALLAX = 256.0
"""Floaters are brought within PARALLAX · √(distance of the nearest one · the scene's): a camera in
the scene sees the shift by as small an angle as the offsets' step beside the nearest one."""

ALIKE = 16.0
"""Floaters within ALIKE times the distance of the nearest one stay: 16 bits suffice for both."""


@dataclass(frozen=True, eq=False)
class Floaters:
    """Floaters among N Gaussians, the nearest first."""

    index: np.ndarray  # [F] which Gaussians
    position: np.ndarray  # [F, 3] where they are stored, scene units
    share: np.ndarray  # [F] that is left of their ways from the scene's middle, 1 if not moved


def find_floaters(position: np.ndarray, largest: float = np.inf) -> Floaters:
    """The floaters among finite positions [N, 3]; coordinates are stored within ± `largest`.

    Distances are from the coordinate-wise median, the largest of the three axes.
    """
    most = max(2, len(position) // SHARE)
    index = np.zeros(0, np.int64)
    if len(position) >= FEWEST:
        middle = np.median(position, axis=0)
        distance = np.abs(position - middle).max(1)
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
    """The least exponent e with all coordinates of positions [N, 3] below 2^e."""
    return int(np.frexp(np.abs(position).max(initial=0))[1])
