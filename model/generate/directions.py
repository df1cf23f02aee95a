"""Directions and rotations in the garden's frame: y points down, so a height h is y = −h."""

import numpy as np

UP = np.array([0.0, -1.0, 0.0])


def unit(vector: np.ndarray) -> np.ndarray:
    """Normalise vectors [..., 3]; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length == 0, 1, length)


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Random unit vectors [count, 3], uniform over the sphere."""
    return unit(rng.standard_normal((count, 3)))


def frames(normal: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Rotations [N, 3, 3]: column 2 is `normal` [N, 3], column 0 is `along` [N, 3] made
    perpendicular to it (the world's x or z axis if the two are parallel)."""
    z = unit(np.asarray(normal, np.float64))
    along = np.broadcast_to(along, z.shape)
    x = along - np.sum(along * z, axis=1, keepdims=True) * z
    axis = np.where(np.abs(z[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    other = axis - np.sum(axis * z, axis=1, keepdims=True) * z
    x = unit(np.where(np.linalg.norm(x, axis=1, keepdims=True) > 1e-6, x, other))
    return np.stack([x, np.cross(z, x), z], axis=2)


def needles(along: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Rotations [N, 3, 3] whose column 0 is `along` [N, 3], column 2 nearly `normal` [N, 3]."""
    side = np.cross(along, normal)
    return frames(np.cross(side, along), along)
