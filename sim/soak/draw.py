"""Random scenes, cameras and memories: difficult cases for a renderer in random mixtures.

A draw depends on its random generator only. Scenes hold float32 values, like a PLY file.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatcore.sim.machine.script import Timing
from splatcore.sim.soak.machines import graded
from splatcore.spec.binning import fits
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.config import Config
from splatcore.spec.scene import ARRAYS, Scene, sh_count

COUNT_MAX = 200  # Gaussians of a layer
LAYERS_MAX = 3
DISTANCE = 4.0  # of the camera from the origin, scene units

Layer = Callable[[np.random.Generator, int], dict[str, np.ndarray]]
"""(generator, count) → arrays of a `Scene` that differ from a plain cloud's."""


def cloud(rng: np.random.Generator, count: int) -> dict:
    """Gaussians of all sizes, some around and behind the camera."""
    return {}


def needles(rng: np.random.Generator, count: int) -> dict:
    """Long Gaussians, up to 10⁵ times thinner than long."""
    thin = 10 ** rng.uniform(-5, -2, (count, 1))
    return {"scale": rng.uniform(0.3, 5, (count, 1)) * np.hstack([np.ones((count, 1)), thin, thin])}


def huge(rng: np.random.Generator, count: int) -> dict:
    """Gaussians larger than the view."""
    return {"scale": np.exp(rng.normal(2, 1, (count, 3)))}


def dots(rng: np.random.Generator, count: int) -> dict:
    """Gaussians smaller than a pixel."""
    return {"scale": np.exp(rng.normal(-7, 1, (count, 3)))}


def equal(rng: np.random.Generator, count: int) -> dict:
    """Gaussians at one to three places, so with equal depths."""
    places = rng.normal(0, 0.5, (1 + int(rng.integers(3)), 3))
    return {"position": places[rng.integers(len(places), size=count)]}


def crowd(rng: np.random.Generator, count: int) -> dict:
    """Gaussians all in one tile, opaque or faint."""
    opacity = rng.choice([0.004, 0.0045, 0.99, 1.0], count)
    small = np.exp(rng.normal(-3, 0.3, (count, 3)))
    return {"position": rng.normal(0, 0.05, (count, 3)), "scale": small, "opacity": opacity}


def behind(rng: np.random.Generator, count: int) -> dict:
    """Gaussians far off on all sides, most of which are culled."""
    return {"position": rng.normal(0, 20, (count, 3))}


LAYERS: tuple[Layer, ...] = (cloud, cloud, needles, huge, dots, equal, crowd, behind)


def layer(rng: np.random.Generator, degree: int) -> Scene:
    """One to `COUNT_MAX` Gaussians of one kind."""
    count = int(np.exp(rng.uniform(0, np.log(COUNT_MAX))))
    plain = {
        "position": rng.normal(0, rng.uniform(0.3, 2), (count, 3)),
        "scale": np.exp(rng.normal(-2.5, 1.0, (count, 3))),
        "quaternion": rng.normal(size=(count, 4)),
        "opacity": rng.uniform(0, 1, count),
        "sh": rng.normal(0, rng.choice([0.1, 0.5, 2.0]), (count, sh_count(degree), 3)),
    }
    kind = LAYERS[rng.integers(len(LAYERS))]
    return Scene(**plain | kind(rng, count))


def scene(rng: np.random.Generator) -> Scene:
    """A scene of up to `LAYERS_MAX` layers; its degree may exceed the machine's."""
    degree = int(rng.integers(4))
    layers = [layer(rng, degree) for _ in range(1 + int(rng.integers(LAYERS_MAX)))]
    joined = {name: np.concatenate([getattr(part, name) for part in layers]) for name in ARRAYS}
    return replace(layers[0], **{name: a.astype(np.float32) for name, a in joined.items()})


def camera(rng: np.random.Generator, config: Config) -> Camera:
    """A camera around the origin, near or among the Gaussians, with an image of any size."""
    width, height = (1 + int(rng.integers(most)) for most in (config.width_max, config.height_max))
    if fits(config, height, width):
        width, height = rng.permutation([width, height]).tolist()
    place = rng.normal(size=3)
    place *= DISTANCE * rng.choice([0.1, 1, 1, 1, 3]) / np.linalg.norm(place)
    focal = min(width, height, 64) * np.exp(rng.normal(0, 0.5))
    found = look_at(place, rng.normal(0, 0.3, 3), width, height, focal)
    middle = rng.choice([0.5, rng.uniform(-0.5, 1.5)])
    pixels = float(rng.choice([0, 0.25, 1, 4, 1000])) if graded(config) else 0.0
    return replace(found, cx=found.width * middle, lod_pixels=pixels)


def timing(rng: np.random.Generator) -> Timing:
    """Memory of random latency and speed, with or without stalls."""
    return Timing(
        "random",
        latency=int(rng.choice([1, 4, 20, 80, 200])),
        bandwidth=float(rng.choice([0, 4, 16, 32])),
        granule=int(rng.choice([0, 32, 64])),
        outstanding=int(rng.choice([1, 2, 8, 64])),
        stall=float(rng.choice([0, 0, 0.1, 0.5])),
        seed=int(rng.integers(1 << 30)),
    )
