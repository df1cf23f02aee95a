"""Real spherical harmonics from scipy's Legendre functions: an oracle for signs and order."""

import math

import numpy as np
from scipy.special import lpmv


def harmonics(direction: np.ndarray, degree: int) -> np.ndarray:
    """Basis functions [D, (degree+1)²] of directions [D, 3], in the order and signs of 3DGS.

    The signs are those of the Condon-Shortley phase, as in `lpmv`: degree 1 is −y, z, −x.
    """
    x, y, z = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).T
    azimuth, columns = np.arctan2(y, x), []
    for l in range(degree + 1):  # noqa: E741
        for m in range(-l, l + 1):
            ratio = math.factorial(l - abs(m)) / math.factorial(l + abs(m))
            scale = math.sqrt((2 * l + 1) / (4 * math.pi) * ratio * (1 if m == 0 else 2))
            wave = np.sin(-m * azimuth) if m < 0 else np.cos(m * azimuth)
            columns.append(scale * lpmv(abs(m), l, z) * wave)
    return np.stack(columns, axis=1)
