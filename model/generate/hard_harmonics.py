"""Hard cases of colour: harmonics of degree 3 where number formats and steps go wrong."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    WIDTH,
    behind_pixel,
    hard_case,
    sh_of_colour,
    spread,
)
from splatcore.spec.camera import look_at
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.scene import Scene, sh_count

COUNT = 300
LARGEST, OUTLIER = 0.01, 10.0  # of the coefficients of a chunk; of one of them
SWING = 1.25  # of the colour about ½ over the sphere: from −2 to 3, two deviations each way

ASIDE = look_at([3.1, -2.3, 1.2], [0.0, 0.0, DEPTH], WIDTH, 48, FOCAL, name="aside")


def _harmonics(rng: np.random.Generator, deviation: float) -> np.ndarray:
    """SH [COUNT, 16, 3] whose colours have that deviation about ½ over the sphere."""
    sh = np.zeros((COUNT, sh_count(SH_DEGREE_MAX), 3))
    sh[:, 1:] = rng.normal(size=(COUNT, len(sh[0]) - 1, 3))
    # The basis is orthonormal: the mean square over the sphere is Σ coefficient² / 4π.
    sh *= deviation / np.sqrt((sh**2).sum(1, keepdims=True) / (4 * np.pi))
    return sh


@hard_case("harmonics that swing from −2 to 3 over the sphere: every degree counts", ASIDE)
def swinging_harmonics(rng: np.random.Generator) -> Scene:
    return replace(spread(rng, COUNT), sh=_harmonics(rng, SWING))


@hard_case("colours that are clamped at 0 seen from half of all directions")
def clamped_harmonics(rng: np.random.Generator) -> Scene:
    sh = _harmonics(rng, 0.5)
    sh[:, :1] = sh_of_colour(np.zeros((COUNT, 3)))[:, :1]
    return replace(spread(rng, COUNT), sh=sh)


@hard_case("directions at a pole and in the planes of the axes: polynomials at 0 and at their ends")
def at_the_poles(rng: np.random.Generator) -> Scene:
    scene = spread(rng, COUNT)
    place = behind_pixel(rng.uniform(0, 63, COUNT), rng.uniform(0, 47, COUNT), DEPTH)
    place[:200, 0] = 0.0
    place[100:, 1] = 0.0
    return replace(scene, position=place, sh=_harmonics(rng, 0.3))


@hard_case("one coefficient a thousand times all others of its chunk: the step is that one's")
def outlying_coefficient(rng: np.random.Generator) -> Scene:
    sh = _harmonics(rng, 1.0)
    sh *= LARGEST / np.abs(sh).max()
    sh[:, :1] = sh_of_colour(rng.uniform(0.1, 0.9, (COUNT, 3)))[:, :1]
    sh[rng.integers(COUNT), 8 + rng.integers(1, 8), rng.integers(3)] = OUTLIER
    return replace(spread(rng, COUNT), sh=sh)


@hard_case("degrees 0 to 3 in one chunk, and a chunk whose bands of degree 3 are all zero")
def mixed_degrees(rng: np.random.Generator) -> Scene:
    scene = replace(spread(rng, COUNT), sh=_harmonics(rng, 0.3))
    degree = rng.integers(0, SH_DEGREE_MAX + 1, COUNT)
    degree[(scene.position[:, :2] > 0).all(1)] %= SH_DEGREE_MAX  # chunks follow places
    for d in range(SH_DEGREE_MAX):
        scene.sh[degree == d, sh_count(d) :] = 0
    return scene
