"""A random scene around the origin, and a camera in front of it."""

import numpy as np

from splatcore.spec.camera import Camera, look_at
from splatcore.spec.scene import Scene

COUNT = 60


def cloud(seed: int, count: int = COUNT, degree: int = 1, spread: float = 1.0) -> Scene:
    """A random scene in front of (and partly behind) the test camera."""
    rng = np.random.default_rng(seed)
    return Scene(
        rng.normal(0, spread, (count, 3)),
        np.exp(rng.normal(-2.0, 1.0, (count, 3))),
        rng.normal(size=(count, 4)),
        rng.uniform(0, 1, count),
        rng.normal(0, 0.5, (count, (degree + 1) ** 2, 3)),
    )


def camera(width: int = 37, height: int = 21) -> Camera:
    return look_at(np.array([0.3, -0.4, -2.0]), np.zeros(3), width, height, 30.0)
