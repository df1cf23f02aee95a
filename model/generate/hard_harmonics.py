"""Hard cases of colour: harmonics of degree 3 that number formats and steps may get wrong, each
with a bound on the loss of packing."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    WIDTH,
    hard_case,
    sh_of_colour,
    spread,
)
from splatcore.spec.camera import look_at
from splatcore.spec.convention import NEAR_PLANE, SH_DEGREE_MAX
from splatcore.spec.memory import CHUNK
from splatcore.spec.scene import Scene, sh_count

COUNT = 300
DEPTHS = 0.75 * DEPTH, 1.5 * DEPTH
FAR_DEPTHS = 1.75 * DEPTH, 1.9 * DEPTH  # of the second chunk, which is stored last
LARGEST, OUTLIER = 0.01, 10.0  # largest coefficient of a chunk, and that of its outlier
SWING = 1.25  # standard deviation of colours around ½ over the sphere; two of them: −2 … 3

ASIDE = look_at([3.1, -2.3, 1.2], [0.0, 0.0, DEPTH], WIDTH, 48, FOCAL, name="aside")


def _harmonics(rng: np.random.Generator, deviation: float) -> np.ndarray:
    """SH [COUNT, 16, 3] whose colours have that standard deviation around ½ over the sphere."""
    sh = np.zeros((COUNT, sh_count(SH_DEGREE_MAX), 3))
    sh[:, 1:] = rng.normal(size=(COUNT, len(sh[0]) - 1, 3))
    # The basis is orthonormal: the mean square over the sphere is Σ coefficient² / 4π.
    sh *= deviation / np.sqrt((sh**2).sum(1, keepdims=True) / (4 * np.pi))
    return sh


def _layers(rng: np.random.Generator) -> tuple[Scene, np.ndarray]:
    """Ordinary Gaussians, and the mask of the second chunk. All depths differ, so that the order of
    storage, which packing changes, does not matter."""
    ends = (*DEPTHS, CHUNK), (*FAR_DEPTHS, COUNT - CHUNK)
    depth = rng.permutation(np.concatenate([np.linspace(*end) for end in ends]))
    return spread(rng, COUNT, depth), depth >= FAR_DEPTHS[0]


@hard_case("harmonics that swing from −2 to 3 over the sphere: every degree counts", ASIDE, 37)
def swinging_harmonics(rng: np.random.Generator) -> Scene:
    return replace(_layers(rng)[0], sh=_harmonics(rng, SWING))


@hard_case("colours that are clamped at 0 seen from half of all directions", packing_db=43)
def clamped_harmonics(rng: np.random.Generator) -> Scene:
    sh = _harmonics(rng, 0.5)
    sh[:, :1] = sh_of_colour(np.zeros((COUNT, 3)))[:, :1]
    return replace(_layers(rng)[0], sh=sh)


@hard_case(
    "directions at a pole and in the planes of the axes: polynomials at 0 and at their ends",
    packing_db=50,
)
def at_the_poles(rng: np.random.Generator) -> Scene:
    scene, _ = _layers(rng)
    place = scene.position.copy()
    place[:200, 0] = 0.0
    place[100:, 1] = 0.0
    return replace(scene, position=place, sh=_harmonics(rng, 0.3))


@hard_case(
    "Gaussians at the camera's own place, which have no direction, and close ahead of it",
    packing_db=44,
)
def at_the_camera(rng: np.random.Generator) -> Scene:
    depth = rng.permutation(np.linspace(*DEPTHS, COUNT))
    depth[:60] = 0.0
    depth[60:160] = NEAR_PLANE * rng.permutation(np.linspace(1.02, 2.0, 100))
    scene = spread(rng, COUNT, depth)
    scene.position[30:60] = rng.normal(0, 1e-6, (30, 3))
    scene.scale[:60] = 0.1
    return replace(scene, sh=_harmonics(rng, 0.3))


@hard_case(
    "one coefficient a thousand times all others of its chunk: the step is that one's",
    packing_db=53,
)
def outlying_coefficient(rng: np.random.Generator) -> Scene:
    sh = _harmonics(rng, 1.0)
    sh *= LARGEST / np.abs(sh).max()
    sh[:, :1] = sh_of_colour(rng.uniform(0.1, 0.9, (COUNT, 3)))[:, :1]
    sh[rng.integers(COUNT), 8 + rng.integers(1, 8), rng.integers(3)] = OUTLIER
    return replace(_layers(rng)[0], sh=sh)


@hard_case(
    "degrees 0 to 3 in one chunk, and a chunk whose bands of degree 3 are all zero", packing_db=48
)
def mixed_degrees(rng: np.random.Generator) -> Scene:
    scene, second = _layers(rng)
    sh = _harmonics(rng, 0.3)
    degree = rng.integers(0, SH_DEGREE_MAX + 1, COUNT)
    degree[second] %= SH_DEGREE_MAX
    for d in range(SH_DEGREE_MAX):
        sh[degree == d, sh_count(d) :] = 0
    return replace(scene, sh=sh)


@hard_case(
    "a chunk that has degree 3 alone, and one whose bands are all zero: steps of nothing",
    packing_db=50,
)
def zero_bands(rng: np.random.Generator) -> Scene:
    scene, second = _layers(rng)
    sh = _harmonics(rng, 0.3)
    sh[:, 1 : sh_count(2)] = 0
    sh[second, 1:] = 0
    return replace(scene, sh=sh)
