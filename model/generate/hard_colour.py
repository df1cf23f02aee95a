"""Hard cases of opacity and colour.

Antialiased scenes, whose opacities are compensated for the blur; many faint splats, one behind the
other; harmonics of degree 3 that number formats and steps may get wrong, each with a bound on the
loss of packing.
"""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    HARD,
    HEIGHT,
    WIDTH,
    behind_pixel,
    hard_case,
    sh_of_colour,
    spread,
    together,
)
from splatcore.spec.camera import look_at
from splatcore.spec.convention import ALPHA_MIN, COVARIANCE_BLUR, NEAR_PLANE, SH_DEGREE_MAX
from splatcore.spec.memory import CHUNK
from splatcore.spec.scene import Scene, sh_count

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

FOG, FOG_ALPHA = 5_000, 1.2 * ALPHA_MIN
LAYERS = 92
EACH, SHARE = 2.0**-11, (0.95, 1.05)
"""Decrease of T that is just too faint, and the shares of it of a black and of a white layer."""

DIM = 0.9, 0.7  # opacities of two layers that reduce T to 0.03, just below 1/32
WIDE = 20.0  # standard deviations of a layer, in widths of the view


def layers(colours: np.ndarray, opacity: np.ndarray, depth: np.ndarray) -> Scene:
    """Splats far larger than the view, one behind the other, with colours [N, 3]."""
    count = len(depth)
    place = behind_pixel((WIDTH - 1) / 2, (HEIGHT - 1) / 2, depth)
    scale = np.tile(WIDE * depth[:, None], (1, 3)) * [1, 1, 1e-4]
    turn = np.tile([1.0, 0, 0, 0], (count, 1))
    return Scene(place, scale, turn, opacity, sh_of_colour(colours))


def dimming(depths: tuple[float, float]) -> Scene:
    """Two grey layers behind which T is just below 1/32."""
    return layers(np.full((2, 3), 0.4), np.array(DIM), np.array(depths))


@hard_case("a fog of 5,000 splats of alpha just above 1/255 behind T of 1/32, bright before black")
def fog(rng: np.random.Generator) -> Scene:
    scene = spread(rng, FOG, np.sort(rng.uniform(3, 30, FOG)), pixels=(8.0, 30.0))
    white = sh_of_colour(np.where(np.arange(FOG)[:, None] < FOG // 2, 1.0, 0.0) * np.ones(3))
    return together(dimming((2.0, 2.5)), replace(scene, opacity=np.full(FOG, FOG_ALPHA), sh=white))


@hard_case(
    "black and white layers in turn at T of 1/32: black ones are just too faint, white ones not"
)
def alternating_layers(rng: np.random.Generator) -> Scene:
    depth = np.linspace(3, 12, LAYERS)
    white = np.arange(LAYERS) % 2
    taken = EACH * np.array(SHARE)[white]
    before = (1 - DIM[0]) * (1 - DIM[1]) - np.cumsum(taken * white) + taken * white
    colours = white[:, None] * np.ones(3) - rng.uniform(0, 0.01, (LAYERS, 3)) * white[:, None]
    return together(dimming((2.0, 2.5)), layers(colours, taken / before, depth))


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


def _two_chunks(rng: np.random.Generator) -> tuple[Scene, np.ndarray]:
    """Ordinary Gaussians, and the mask of the second chunk. All depths differ, so that the order of
    storage, which packing changes, does not matter."""
    ends = (*DEPTHS, CHUNK), (*FAR_DEPTHS, COUNT - CHUNK)
    depth = rng.permutation(np.concatenate([np.linspace(*end) for end in ends]))
    return spread(rng, COUNT, depth), depth >= FAR_DEPTHS[0]


@hard_case("harmonics that swing from −2 to 3 over the sphere: every degree counts", ASIDE, 37)
def swinging_harmonics(rng: np.random.Generator) -> Scene:
    return replace(_two_chunks(rng)[0], sh=_harmonics(rng, SWING))


@hard_case("colours that are clamped at 0 seen from half of all directions", packing_db=43)
def clamped_harmonics(rng: np.random.Generator) -> Scene:
    sh = _harmonics(rng, 0.5)
    sh[:, :1] = sh_of_colour(np.zeros((COUNT, 3)))[:, :1]
    return replace(_two_chunks(rng)[0], sh=sh)


@hard_case(
    "directions at a pole and in the planes of the axes: polynomials at 0 and at their ends",
    packing_db=50,
)
def at_the_poles(rng: np.random.Generator) -> Scene:
    scene, _ = _two_chunks(rng)
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
    return replace(_two_chunks(rng)[0], sh=sh)


@hard_case(
    "degrees 0 to 3 in one chunk, and a chunk whose bands of degree 3 are all zero", packing_db=48
)
def mixed_degrees(rng: np.random.Generator) -> Scene:
    scene, second = _two_chunks(rng)
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
    scene, second = _two_chunks(rng)
    sh = _harmonics(rng, 0.3)
    sh[:, 1 : sh_count(2)] = 0
    sh[second, 1:] = 0
    return replace(scene, sh=sh)
