"""The lower-triangular factor L of a covariance Σ = M·Mᵀ = L·Lᵀ, without computing Σ."""

import numpy as np


def lower_triangular(factor: np.ndarray) -> np.ndarray:
    """L [N, 3, 3] with L·Lᵀ = M·Mᵀ and no negative diagonal element, for factors M [N, 3, 3].

    Mᵀ = Q·R gives M·Mᵀ = Rᵀ·R, so L = Rᵀ up to the signs of its columns. Nothing is squared, so a
    needle of axis ratio 1e5 keeps its thickness; a Cholesky decomposition of Σ would lose it.
    """
    upper = np.linalg.qr(np.swapaxes(factor, 1, 2), mode="r")
    sign = np.where(np.diagonal(upper, axis1=1, axis2=2) < 0, -1.0, 1.0)
    return np.swapaxes(upper * sign[:, :, None], 1, 2) + 0.0


def largest_axis(factor: np.ndarray) -> np.ndarray:
    """Largest standard deviation [N] of Gaussians with factors [N, 3, 3]: the singular value."""
    return np.linalg.svd(factor, compute_uv=False)[:, 0]
