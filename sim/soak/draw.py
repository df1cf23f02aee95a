"""Random scenes, cameras and memories: what a renderer may stumble over, in new mixtures.

A draw is a function of its generator alone. Scenes hold what a PLY file holds, float32.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from splatcore.sim.machine.script import Timing
from splatcore.spec.binning import fits
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.config import Config
from splatcore.spec.scene import ARRAYS, Scene, sh_count

COUNT_MAX = 200  # Gaussians of a layer
LAYERS_MAX = 3
DISTANCE = 4.0  # of the camera from the origin, scene units

Layer = Callable[[np.random.Generator, int], dict[str, np.ndarray]]
"""(generator, count) → arrays of a `Scene` that are not a plain cloud's."""


def cloud(rng: np.random.Generator, count: int) -> dict:
    """Of all sizes, some around the camera and behind it."""
    return {}


def needles(rng: np.random.Generator, count: int) -> dict:
    """Long, and up to 10⁵ times thinner."""
    thin = 10 ** rng.uniform(-5, -2, (count, 1))
    return {"scale": rng.uniform(0.3, 5, (count, 1)) * np.hstack([np.ones((count, 1)), thin, thin])}


def huge(rng: np.random.Generator, count: int) -> dict:
    """Larger than the view; a few."""
    return {"scale": np.exp(rng.normal(2, 1, (count, 3)))}


def dots(rng: np.random.Generator, count: int) -> dict:
    """Smaller than a pixel."""
    return {"scale": np.exp(rng.normal(-7, 1, (count, 3)))}


def equal(rng: np.random.Generator, count: int) -> dict:
    """At a few places, so of few depths: ties."""
    places = rng.normal(0, 0.5, (1 + int(rng.integers(3)), 3))
    return {"position": places[rng.integers(len(places), size=count)]}


def crowd(rng: np.random.Generator, count: int) -> dict:
    """All in one tile, opaque or faint."""
    opacity = rng.choice([0.004, 0.0045, 0.99, 1.0], count)
    small = np.exp(rng.normal(-3, 0.3, (count, 3)))
    return {"position": rng.normal(0, 0.05, (count, 3)), "scale": small, "opacity": opacity}


def behind(rng: np.random.Generator, count: int) -> dict:
    """Far to all sides: most of it is culled."""
    return {"position": rng.normal(0, 20, (count, 3))}


LAYERS: tuple[Layer, ...] = (cloud, cloud, needles, huge, dots, equal, crowd, behind)


def layer(rng: np.random.Generator, degree: int) -> Scene:
    """Gaussians of one kind, one to many."""
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
    """Up to `LAYERS_MAX` layers, of a degree that may be above the machine's."""
    degree = int(rng.integers(4))
    layers = [layer(rng, degree) for _ in range(1 + int(rng.integers(LAYERS_MAX)))]
    joined = {name: np.concatenate([getattr(part, name) for part in layers]) for name in ARRAYS}
    return replace(layers[0], **{name: a.astype(np.float32) for name, a in joined.items()})


def camera(rng: np.random.Generator, config: Config) -> Camera:
    """Anywhere around the origin, near or in the middle of the Gaussians; an image of any size."""
    width, height = (1 + int(rng.integers(most)) for most in (config.width_max, config.height_max))
    if fits(config, height, width):
        width, height = rng.permutation([width, height]).tolist()
    place = rng.normal(size=3)
    place *= DISTANCE * rng.choice([0.1, 1, 1, 1, 3]) / np.linalg.norm(place)
    focal = min(width, height, 64) * np.exp(rng.normal(0, 0.5))
    found = look_at(place, rng.normal(0, 0.3, 3), width, height, focal)
    middle = rng.choice([0.5, rng.uniform(-0.5, 1.5)])
    return replace(found, cx=found.width * middle)


def timing(rng: np.random.Generator) -> Timing:
    """Memory of any latency and speed, that stalls or not."""
    return Timing(
        "random",
        latency=int(rng.choice([1, 4, 20, 80, 200])),
        bandwidth=float(rng.choice([0, 4, 16, 32])),
        granule=int(rng.choice([0, 32, 64])),
        outstanding=int(rng.choice([1, 2, 8, 64])),
        stall=float(rng.choice([0, 0, 0.1, 0.5])),
        seed=int(rng.integers(1 << 30)),
    )
