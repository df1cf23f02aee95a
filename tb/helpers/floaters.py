"""Scenes with floaters, and with extreme numbers."""

from dataclasses import replace

import numpy as np

from splatcore.spec.scene import Scene


def ball(count: int = 700, seed: int = 0) -> Scene:
    """Small opaque Gaussians within 1 of the origin, so that their positions matter."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3))
    way *= (rng.uniform(0, 1, count) ** (1 / 3) / np.linalg.norm(way, axis=1))[:, None]
    return Scene(
        way,
        np.exp(rng.uniform(-4.5, -3, (count, 3))),
        rng.normal(size=(count, 4)),
        rng.uniform(0.3, 1, count),
        rng.uniform(-1.5, 1.5, (count, 1, 3)),
    )


def strewn(scene: Scene, count: int, distance: float, axes: int = 3, seed: int = 1) -> Scene:
    """Move `count` Gaussians away to about `distance`, along one axis or three."""
    rng, position = np.random.default_rng(seed), scene.position.copy()
    rows = rng.choice(len(scene), count, replace=False)
    way = rng.normal(size=(count, axes))
    way /= np.linalg.norm(way, axis=1)[:, None]
    position[rows, :axes] = way * distance * rng.uniform(0.5, 1, (count, 1))
    return replace(scene, position=position)


EXTREME = (3.4e38, 1e30, 1e20, 1e10, 1e-10, 1e-38, 1e-45, 0.0)


def with_extremes(scene: Scene, name: str, value: float, count: int) -> Scene:
    """Make one field of `count` Gaussians extreme, with either sign if allowed."""
    array, rng = getattr(scene, name).copy(), np.random.default_rng(7)
    rows = rng.choice(len(scene), count, replace=False)
    signs = rng.choice([-1, 1], array[rows].shape) if name not in ("scale", "opacity") else 1
    array[rows] = np.minimum(value, 1) if name == "opacity" else value * signs
    return replace(scene, **{name: array})
