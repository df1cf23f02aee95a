"""Hard cases of antialiased scenes, whose opacities are compensated for the blur."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    HARD,
    WIDTH,
    hard_case,
    spread,
    together,
)
from splatcore.spec.convention import ALPHA_MIN, COVARIANCE_BLUR
from splatcore.spec.scene import Scene

PIXEL = DEPTH / FOCAL
"""Scene units of a pixel at `DEPTH`."""

LONG, THIN = 500.0, (0.001, 0.02)  # standard deviations of needles in pixels

EDGE = 0.3  # largest relative deviation of compensated opacities from 1/255


def marked(scene: Scene) -> Scene:
    """The scene, marked as trained with antialiasing."""
    return replace(scene, antialiased=True)


@hard_case("antialiased splats of 0.01 to 1 pixel: 3e-4 to 0.8 of the opacity is left")
def antialiased_dust(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 4_000)
    size = np.geomspace(0.01, 1, 4_000)[:, None] * rng.uniform(0.7, 1, (4_000, 3))
    return marked(replace(scene, scale=rng.permutation(size) * PIXEL))


@hard_case("antialiased needles 500 pixels long, 0.001 to 0.02 wide: 1/550 to 1/27 of the opacity")
def antialiased_needles(rng: np.random.Generator) -> Scene:
    scene, thin = spread(rng, 80), np.geomspace(*THIN, 80)[:, None]
    scale = np.concatenate([np.full((80, 1), LONG), thin, thin], axis=1)
    return marked(replace(scene, scale=scale * PIXEL))


@hard_case("antialiased: the factor brings opacities to 1/255 and a little above and below")
def antialiased_edge(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 2_000)
    size = rng.uniform(0.05, 0.5, 2_000)
    factor = size**2 / (size**2 + COVARIANCE_BLUR)
    opacity = ALPHA_MIN / factor * rng.uniform(1 - EDGE, 1 + EDGE, 2_000)
    scene = replace(scene, scale=np.tile(size[:, None] * PIXEL, (1, 3)), opacity=opacity)
    return marked(together(spread(rng, 40), scene))


@hard_case("antialiased disks seen edge-on: the minors cancel to the last bits of their products")
def antialiased_edge_on(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    ray = scene.position / np.linalg.norm(scene.position, axis=1, keepdims=True)
    across = np.cross(ray, rng.standard_normal((300, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    tilt = np.where(np.arange(300) % 2, 10.0 ** rng.uniform(-7, -1, 300), 0)[:, None]
    normal = np.cos(tilt) * across + np.sin(tilt) * ray
    # the shortest turn of the thin axis, z, to the normal
    turn = np.stack([1 + normal[:, 2], -normal[:, 1], normal[:, 0], np.zeros(300)], axis=1)
    scale = rng.uniform(1, 40, (300, 1)) * [1, 1, 1e-5] * PIXEL
    return marked(replace(scene, scale=scale, quaternion=turn))


@hard_case("antialiased splats as large as the picture and far larger: nothing of them is taken")
def antialiased_whole(rng: np.random.Generator) -> Scene:
    huge = spread(rng, 8, np.geomspace(2, 100, 8), pixels=(0.5 * WIDTH, 20 * WIDTH))
    huge = replace(huge, opacity=rng.uniform(0.2, 0.6, 8))
    return marked(together(huge, spread(rng, 60, pixels=(0.1, 4.0))))


ANTIALIASED = tuple(name for name in HARD if name.startswith("antialiased_"))
"""Names of these cases; machines without compensation refuse them."""
