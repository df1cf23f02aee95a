"""Scenes of round Gaussians at given positions, for tests of cameras."""

import numpy as np

from splatcore.model.generate.directions import random_directions
from splatcore.spec.scene import Gaussians


def gaussians(position, scale=0.05, opacity=0.9) -> Gaussians:
    """Round Gaussians at `position` [N, 3]."""
    count = len(position)
    factor = np.zeros((count, 3, 3))
    factor[:, range(3), range(3)] = scale
    opacity = np.broadcast_to(np.asarray(opacity, float), count)
    return Gaussians(np.asarray(position, float), factor, opacity, np.zeros((count, 1, 3)))


def ball(count=2_000, middle=(0, 0, 0), radius=1.0, seed=0) -> np.ndarray:
    """Random points [count, 3] on a sphere."""
    return random_directions(np.random.default_rng(seed), count) * radius + middle


def boxes(seed: int, *parts: tuple) -> np.ndarray:
    """Random points [N, 3] in boxes. parts: (count, half sides [3], middle [3]) of each box."""
    rng = np.random.default_rng(seed)
    points = [rng.uniform(-1, 1, (count, 3)) * half + np.array(at) for count, half, at in parts]
    return np.concatenate(points)


def joined(*parts: Gaussians) -> Gaussians:
    """The Gaussians of all parts, in order."""
    names = ("position", "factor", "opacity", "sh")
    return Gaussians(*(np.concatenate([getattr(part, n) for part in parts]) for n in names))
