"""The hard cases by name: small scenes, each with a corner case where renderers go wrong.

The order is: antialiased scenes, faint splats, harmonics (all in `hard_colour`); shape and place
(axis ratios, sizes, depths, lists, coordinates); values (opacities, transmittance, colours, unusual
file content); picture sizes.
"""

from dataclasses import replace

import numpy as np

from splatcore.model.generate import hard_colour  # noqa: F401, enters its cases
from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    HARD,
    HEIGHT,
    WIDTH,
    HardCase,
    behind_pixel,
    hard_case,
    in_one_tile,
    sh_of_colour,
    spread,
    straight_camera,
    together,
)
from splatcore.spec.camera import look_at
from splatcore.spec.convention import ALPHA_MAX, ALPHA_MIN, NEAR_PLANE, TRANSMITTANCE_MIN
from splatcore.spec.scene import ARRAYS, Scene

__all__ = ["HARD", "HardCase"]

AXIS_RATIO = 1e5
FARTHEST = 2e4
LONG_LIST = 20_000
EQUAL_DEPTHS = 3_000
FAR_PLACE = np.array([1e4, -0.8e4, 1.2e4])
FAR_EYE = FAR_PLACE + np.array([2.4, -1.1, -3.3])
FAR_CAMERA = look_at(FAR_EYE, FAR_PLACE, WIDTH, HEIGHT, FOCAL, name="far")

GRID = 4  # pixels between neighbours of a grid of pixel centres

TINY = 1e-9
"""Standard deviation, scene units, far below the blur: alpha at the centre is the opacity."""

LAYER_ALPHA = 0.9  # opacity of each of the three layers that bring T to about 1e-3


@hard_case("axis ratio 1e5 along one axis: the 2D covariance is singular but for the blur")
def needles(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    long = rng.uniform(2, 30, (300, 1)) * DEPTH / FOCAL
    return replace(scene, scale=long * [1, 1 / AXIS_RATIO, 1 / AXIS_RATIO])


@hard_case("axis ratio 1e5 across a disk, some edge-on: large terms cancel in the determinant")
def flakes(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    wide = rng.uniform(1, 12, (300, 1)) * DEPTH / FOCAL
    quaternion = scene.quaternion.copy()
    quaternion[:60] = [np.sqrt(0.5), np.sqrt(0.5), 0, 0]  # thin axis along −y: edge-on
    return replace(scene, scale=wide * [1, 1, 1 / AXIS_RATIO], quaternion=quaternion)


@hard_case("splats larger than the screen: every tile, extents far beyond the guard band")
def whole_screen(rng: np.random.Generator) -> Scene:
    huge = spread(rng, 8, np.geomspace(2, 200, 8), pixels=(1.5 * WIDTH, 40 * WIDTH))
    huge = replace(huge, opacity=rng.uniform(0.2, 0.6, 8))
    return together(huge, spread(rng, 60))


@hard_case("far smaller than a pixel: the covariance underflows, only the blur is left")
def sub_pixel(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 2_000)
    scale = np.geomspace(1e-4, 0.1, 2_000)[:, None] * DEPTH / FOCAL
    return replace(scene, scale=scale * rng.uniform(0.3, 1.0, (2_000, 3)))


@hard_case("3,000 equal depths in one tile: no key tells them apart, storage order decides")
def equal_depths(rng: np.random.Generator) -> Scene:
    scene = in_one_tile(rng, spread(rng, EQUAL_DEPTHS, pixels=(0.2, 2.0)), np.array(DEPTH))
    return replace(scene, opacity=rng.uniform(0.01, 0.06, EQUAL_DEPTHS))


@hard_case("20,000 faint splats in one tile, none hidden: the list outgrows every buffer")
def long_list(rng: np.random.Generator) -> Scene:
    depth = rng.uniform(1.0, 9.0, LONG_LIST)
    scene = in_one_tile(rng, spread(rng, LONG_LIST, depth, pixels=(0.1, 0.6)), depth)
    return replace(scene, opacity=rng.uniform(0.010, 0.020, LONG_LIST))


@hard_case("depths from 0.2 to 20,000 in one tile: five decades for one sort key")
def depth_range(rng: np.random.Generator) -> Scene:
    depth = np.geomspace(NEAR_PLANE, FARTHEST, 600)
    depth[0] = np.nextafter(NEAR_PLANE, 1)
    order = rng.permutation(600)
    scene = in_one_tile(rng, spread(rng, 600, depth[order], pixels=(0.3, 3.0)), depth[order])
    return replace(scene, opacity=rng.uniform(0.02, 0.3, 600))


@hard_case("centres on, just before and just behind the near plane, bodies across it: huge 1/z")
def near_plane(rng: np.random.Generator) -> Scene:
    exact = [0.0, 1e-12, -1e-12, 1e-6, -1e-6, 1e-3, -1e-3, 0.02, -0.02]
    grazing = np.concatenate([[np.nextafter(NEAR_PLANE, 1), np.nextafter(NEAR_PLANE, 0)]] * 4)
    depth = np.concatenate([NEAR_PLANE + np.repeat(exact, 6), grazing])
    close = spread(rng, len(depth), depth, pixels=(0.5, 6.0))
    crossing = spread(rng, 24, rng.uniform(-0.2, 0.8, 24), pixels=(1, 2))
    scale, opacity = rng.uniform(0.05, 0.5, (24, 3)), rng.uniform(0.05, 0.4, 24)
    crossing = replace(crossing, scale=scale, opacity=opacity)  # they reach past the plane
    return together(close, crossing, spread(rng, 60))


@hard_case("the camera stands inside Gaussians: their projection covers the image many times")
def camera_inside(rng: np.random.Generator) -> Scene:
    around = spread(rng, 12, np.linspace(-0.6, 1.2, 12))
    around = replace(around, scale=rng.uniform(0.8, 3.0, (12, 3)), opacity=np.full(12, 0.3))
    return together(around, spread(rng, 80))


@hard_case(
    "coordinates around 1e4 seen from 4 units: the view transform cancels large numbers", FAR_CAMERA
)
def far_from_origin(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 400, rng.uniform(2, 8, 400), pixels=(0.4, 3.0))
    return replace(scene, position=scene.position - [0, 0, DEPTH] + FAR_PLACE)


def _dots(u: np.ndarray, v: np.ndarray, depth: np.ndarray, opacity: np.ndarray) -> Scene:
    """Round dots exactly at pixel centres, without rounding errors if `depth` is a power of two."""
    count = len(opacity)
    identity = np.tile([1.0, 0, 0, 0], (count, 1))
    sh = sh_of_colour(np.full((count, 3), 0.75))
    return Scene(behind_pixel(u, v, depth), np.full((count, 3), TINY), identity, opacity, sh)


def _grid() -> tuple[np.ndarray, np.ndarray]:
    """Pixels (u, v) of a grid over the 64×48 image, row by row."""
    v, u = np.mgrid[2:HEIGHT:GRID, 2:WIDTH:GRID]
    return u.ravel(), v.ravel()


@hard_case("opacity at 0, 1/255, 0.99, 1 and their neighbours: which pixel is skipped or clamped")
def opacity_edge(rng: np.random.Generator) -> Scene:
    edges = []
    for value in (ALPHA_MIN, ALPHA_MAX, 1.0, 0.0):
        single = float(np.float32(value))
        edges += [value, np.nextafter(value, 0), np.nextafter(value, 1), single]
        edges += [value * (1 - 1e-6), min(value * (1 + 1e-6), 1.0)]
    u, v = _grid()
    opacity = rng.permutation(np.resize(edges, len(u)))
    return _dots(u, v, DEPTH, opacity)


@hard_case("T lands on 1e-4 or a hair beside it: whether the last Gaussian is blended")
def transmittance_edge(rng: np.random.Generator) -> Scene:
    u, v = _grid()
    before = (1 - LAYER_ALPHA) * (1 - LAYER_ALPHA) * (1 - LAYER_ALPHA)
    offset = 10.0 ** rng.uniform(-16, -2, len(u)) * rng.choice([-1, 0, 1], len(u))
    last = 1 - TRANSMITTANCE_MIN * (1 + offset) / before  # T then is 1e-4·(1 + offset)
    layers = [_dots(u, v, z, np.full(len(u), LAYER_ALPHA)) for z in (1.0, 2.0, 4.0)]
    layers += [_dots(u, v, 8.0, last), _dots(u, v, 16.0, np.full(len(u), ALPHA_MAX))]
    return together(*layers)


@hard_case("colours far below 0 and above 1: clamped at 0 before blending, at 1 only after")
def saturated_colours(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    sh = sh_of_colour(rng.uniform(-3, 4, (300, 3)))
    sh[150:, 1:] = rng.normal(0, 3, (150, 3, 3))  # clamped or not by the view direction
    return replace(scene, sh=sh)


@hard_case("one, two or all three scales are 0: a singular 3D covariance, log of zero in files")
def zero_scales(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 280)
    kept = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)][:7])
    return replace(scene, scale=scene.scale * np.resize(kept, (280, 3)))


@hard_case("quaternions of norm 1e-6 to 1e6 and 0: a rotation only after normalisation")
def unnormalised_quaternions(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    norm = np.geomspace(1e-6, 1e6, 300)
    norm[::50] = 0.0
    quaternion = scene.quaternion / np.linalg.norm(scene.quaternion, axis=1, keepdims=True)
    return replace(scene, quaternion=quaternion * norm[:, None])


@hard_case("NaN and Inf in every field among good Gaussians: they must vanish and be counted")
def not_finite(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    arrays = {name: getattr(scene, name).copy() for name in ARRAYS}
    bad = rng.permutation(300)[: 3 * len(arrays)].reshape(len(arrays), 3)
    for array, rows in zip(arrays.values(), bad, strict=True):
        flat = array.reshape(300, -1)
        flat[rows, rng.integers(flat.shape[1], size=3)] = [np.nan, np.inf, -np.inf]
    return replace(scene, **arrays)


@hard_case("no Gaussian at all: empty arrays, empty lists, and still a frame")
def empty(rng: np.random.Generator) -> Scene:
    return spread(rng, 1)[:0]


@hard_case("one Gaussian: chunks and lists of a single entry")
def one(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 1, pixels=(6.0, 9.0))
    centre, sh = behind_pixel([WIDTH / 2], [HEIGHT / 2], DEPTH), sh_of_colour([[0.9, 0.5, 0.2]])
    return replace(scene, position=centre, opacity=np.array([0.9]), sh=sh)


@hard_case(
    "37×19 pixels: the last tiles hang over the right and lower edge", straight_camera(37, 19)
)
def odd_size(rng: np.random.Generator) -> Scene:
    return spread(rng, 300)


@hard_case(
    "an image of one pixel: a single tile of which 255 pixels are outside", straight_camera(1, 1)
)
def one_pixel(rng: np.random.Generator) -> Scene:
    near = spread(rng, 40, rng.uniform(1, 6, 40))
    return replace(near, position=near.position * [4 / FOCAL, 4 / FOCAL, 1])
