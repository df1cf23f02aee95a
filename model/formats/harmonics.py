"""The real spherical harmonics of 3DGS in numpy: their values, and their rotation matrices."""

import numpy as np

from splatcore.spec.colour import FOLDED
from splatcore.spec.scene import sh_count


def harmonics(direction: np.ndarray, degree: int) -> np.ndarray:
    """Values [D, (degree+1)²] of the basis functions in unit directions [D, 3].

    Order and signs are those of 3DGS: the polynomials of `spec.colour`, times their constants.
    """
    x, y, z = np.asarray(direction, np.float64).T
    xx, yy, zz = x * x, y * y, z * z
    of_degree = (
        (np.ones_like(x),),
        (y, z, x),
        (2 * x * y, 2 * y * z, (3 * zz - 1) / 2, 2 * x * z, xx - yy),
        (
            y * (3 * xx - yy), 4 * x * y * z, y * (5 * zz - 1), z * (5 * zz - 3) / 2,
            x * (5 * zz - 1), 2 * z * (xx - yy), x * (3 * yy - xx),
        ),
    )  # fmt: skip
    parts = [np.stack(of_degree[d], axis=1) * FOLDED[d] for d in range(degree + 1)]
    return np.concatenate(parts, axis=1)


def directions(count: int) -> np.ndarray:
    """Unit vectors [count, 3], spread evenly over the sphere (a Fibonacci lattice)."""
    index = np.arange(count)
    z, turn = 1 - (2 * index + 1) / count, np.pi * (3 - np.sqrt(5)) * index
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def turn_of(matrix: np.ndarray, degree: int) -> np.ndarray:
    """The matrix T [K, K], K = (degree+1)², by which a rotation or reflection acts on coefficients.

    matrix: M [3, 3], maps axes to axes

    Coefficients T·sh give the same colour in direction M·d as sh in d. T is orthogonal and
    block-diagonal by degree; each block is the least-squares solution of Y(M·d) = T·Y(d). Entries
    0, ±½ and ±1 are exact, others (√3/2, √15/4 …) within 1e-15.
    """
    points = directions(64)
    here, there = harmonics(points, degree), harmonics(points @ matrix.T, degree)
    found = np.zeros((sh_count(degree), sh_count(degree)))
    for d in range(degree + 1):
        block = slice(d * d, (d + 1) ** 2)
        found[block, block] = np.linalg.lstsq(here[:, block], there[:, block])[0].T
    halves = np.rint(2 * found) / 2
    return np.where(np.abs(found - halves) < 1e-12, halves, found)
