"""Points and values spread over surfaces: even sequences, and smooth noise."""

import numpy as np

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Angle between successive points of Vogel's sunflower spiral, radians."""

PLASTIC = 1.32471795724474602596
"""Root of x³ = x + 1: the step of the two-dimensional low-discrepancy sequence of M. Roberts."""

COVER = 0.74
"""Standard deviation over spacing with which opaque splats on a sunflower spiral leave no holes."""


def sunflower(count: int, core: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a disk, evenly spread by Vogel's spiral with density (1 + r²/core²)^−1.5.

    core, radius: scene units
    Returns plane coordinates [count, 2] and the local spacing [count]; splats of standard deviation
    COVER·spacing leave no holes.
    """
    u = (np.arange(count) + 0.5) / count
    within = 1 - (1 + (radius / core) ** 2) ** -0.5
    falloff = 1 - u * within  # (1 + r²/core²)^−0.5
    r = core * np.sqrt(falloff**-2 - 1)
    angle = np.arange(count) * GOLDEN_ANGLE
    spacing = core * np.sqrt(2 * np.pi * within / (count * falloff**3))
    return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1), spacing


def even_pairs(count: int) -> np.ndarray:
    """Evenly spread points [count, 2] of the unit square, the same for every call."""
    step = np.array([1 / PLASTIC, 1 / PLASTIC**2])
    return np.modf(0.5 + np.arange(1, count + 1)[:, None] * step)[0]


def noise(x: np.ndarray, z: np.ndarray, seed: int, octaves: int = 3) -> np.ndarray:
    """Smooth noise in [0, 1] at plane coordinates, in units of cells (broadcastable arrays).

    Value noise on a repeating 64×64 lattice; each octave has half the cell size and half the
    weight of the one before.
    """
    table = np.random.default_rng(seed).random((64, 64))
    total = np.zeros(np.broadcast(x, z).shape)
    for octave in range(octaves):
        at_x, at_z = (np.asarray(c) * 2.0**octave + 17.3 * octave for c in (x, z))
        i, j = np.floor(at_x).astype(np.int64), np.floor(at_z).astype(np.int64)
        p, q = at_x - i, at_z - j
        p, q = p * p * (3 - 2 * p), q * q * (3 - 2 * q)
        corner = [[table[(i + m) % 64, (j + n) % 64] for n in (0, 1)] for m in (0, 1)]
        low = corner[0][0] * (1 - q) + corner[0][1] * q
        high = corner[1][0] * (1 - q) + corner[1][1] * q
        total += (low * (1 - p) + high * p) * 0.5**octave
    return total / (2 - 0.5 ** (octaves - 1))
