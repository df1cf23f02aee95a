"""Hard cases of value and size: opacities, transmittance, colours, odd file content, odd images."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    HEIGHT,
    WIDTH,
    behind_pixel,
    hard_case,
    sh_of_colour,
    spread,
    straight_camera,
    together,
)
from splatcore.spec.convention import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN
from splatcore.spec.scene import Scene

GRID = 4
"""Pixels between neighbours of a grid of pixel centres."""

TINY = 1e-9
"""Standard deviation, scene units, that the blur swamps: alpha at the centre is the opacity."""

LAYER_ALPHA = 0.9
"""Opacity of each of the three layers that bring T to about 1e-3."""


def _dots(u: np.ndarray, v: np.ndarray, depth: np.ndarray, opacity: np.ndarray) -> Scene:
    """Round dots exactly at pixel centres (powers of two: no rounding on the way there)."""
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
    scene = replace(scene, scale=scene.scale * np.resize(kept, (280, 3)))
    return scene


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
    arrays = {
        name: getattr(scene, name).copy()
        for name in ("position", "scale", "quaternion", "opacity", "sh")
    }
    bad = rng.permutation(300)[: 3 * len(arrays)].reshape(len(arrays), 3)
    for array, rows in zip(arrays.values(), bad, strict=True):
        flat = array.reshape(300, -1)
        flat[rows, rng.integers(flat.shape[1], size=3)] = [np.nan, np.inf, -np.inf]
    return Scene(**arrays)


@hard_case("no Gaussian at all: empty arrays, empty lists, and still a frame")
def empty(rng: np.random.Generator) -> Scene:
    return spread(rng, 1)[:0]


@hard_case("one Gaussian: chunks and lists of a single entry")
def one(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 1, pixels=(6.0, 9.0))
    centre = behind_pixel([WIDTH / 2], [HEIGHT / 2], DEPTH)
    scene = replace(scene, position=centre, opacity=np.array([0.9]))
    scene = replace(scene, sh=sh_of_colour(np.array([[0.9, 0.5, 0.2]])))
    return scene


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
    near = replace(near, position=near.position * [4 / FOCAL, 4 / FOCAL, 1])
    return near
