"""Hard cases of shape and place: extreme axis ratios, sizes, depths, lists, coordinates."""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.hard_case import (
    DEPTH,
    FOCAL,
    HEIGHT,
    WIDTH,
    hard_case,
    in_one_tile,
    spread,
    together,
)
from splatcore.spec.camera import look_at
from splatcore.spec.convention import NEAR_PLANE
from splatcore.spec.scene import Scene

AXIS_RATIO = 1e5
FARTHEST = 2e4
LONG_LIST = 20_000
EQUAL_DEPTHS = 3_000
FAR_PLACE = np.array([1e4, -0.8e4, 1.2e4])
FAR_EYE = FAR_PLACE + np.array([2.4, -1.1, -3.3])
FAR_CAMERA = look_at(FAR_EYE, FAR_PLACE, WIDTH, HEIGHT, FOCAL, name="far")


@hard_case("axis ratio 1e5 along one axis: the 2D covariance is singular but for the blur")
def needles(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    long = rng.uniform(2, 30, (300, 1)) * DEPTH / FOCAL
    scene = replace(scene, scale=long * [1, 1 / AXIS_RATIO, 1 / AXIS_RATIO])
    return scene


@hard_case("axis ratio 1e5 across a disk, some edge-on: large terms cancel in the determinant")
def flakes(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 300)
    wide = rng.uniform(1, 12, (300, 1)) * DEPTH / FOCAL
    quaternion = scene.quaternion.copy()
    quaternion[:60] = [np.sqrt(0.5), np.sqrt(0.5), 0, 0]  # thin axis along −y: edge-on
    scene = replace(scene, scale=wide * [1, 1, 1 / AXIS_RATIO], quaternion=quaternion)
    return scene


@hard_case("splats larger than the screen: every tile, extents far beyond the guard band")
def whole_screen(rng: np.random.Generator) -> Scene:
    huge = spread(rng, 8, np.geomspace(2, 200, 8), pixels=(1.5 * WIDTH, 40 * WIDTH))
    huge = replace(huge, opacity=rng.uniform(0.2, 0.6, 8))
    return together(huge, spread(rng, 60))


@hard_case("far smaller than a pixel: the covariance underflows, only the blur is left")
def sub_pixel(rng: np.random.Generator) -> Scene:
    scene = spread(rng, 2_000)
    scale = np.geomspace(1e-4, 0.1, 2_000)[:, None] * DEPTH / FOCAL
    scene = replace(scene, scale=scale * rng.uniform(0.3, 1.0, (2_000, 3)))
    return scene


@hard_case("3,000 equal depths in one tile: no key tells them apart, storage order decides")
def equal_depths(rng: np.random.Generator) -> Scene:
    scene = in_one_tile(rng, spread(rng, EQUAL_DEPTHS, pixels=(0.2, 2.0)), np.array(DEPTH))
    scene = replace(scene, opacity=rng.uniform(0.01, 0.06, EQUAL_DEPTHS))
    return scene


@hard_case("20,000 faint splats in one tile, none hidden: the list outgrows every buffer")
def long_list(rng: np.random.Generator) -> Scene:
    depth = rng.uniform(1.0, 9.0, LONG_LIST)
    scene = in_one_tile(rng, spread(rng, LONG_LIST, depth, pixels=(0.1, 0.6)), depth)
    scene = replace(scene, opacity=rng.uniform(0.010, 0.020, LONG_LIST))
    return scene


@hard_case("depths from 0.2 to 20,000 in one tile: five decades for one sort key")
def depth_range(rng: np.random.Generator) -> Scene:
    depth = np.geomspace(NEAR_PLANE, FARTHEST, 600)
    depth[0] = np.nextafter(NEAR_PLANE, 1)
    order = rng.permutation(600)
    scene = in_one_tile(rng, spread(rng, 600, depth[order], pixels=(0.3, 3.0)), depth[order])
    scene = replace(scene, opacity=rng.uniform(0.02, 0.3, 600))
    return scene


@hard_case("centres on, just before and just behind the near plane, bodies across it: huge 1/z")
def near_plane(rng: np.random.Generator) -> Scene:
    exact = [0.0, 1e-12, -1e-12, 1e-6, -1e-6, 1e-3, -1e-3, 0.02, -0.02]
    grazing = np.concatenate([[np.nextafter(NEAR_PLANE, 1), np.nextafter(NEAR_PLANE, 0)]] * 4)
    depth = np.concatenate([NEAR_PLANE + np.repeat(exact, 6), grazing])
    close = spread(rng, len(depth), depth, pixels=(0.5, 6.0))
    crossing = spread(rng, 24, rng.uniform(-0.2, 0.8, 24), pixels=(1, 2))
    crossing = replace(crossing, scale=rng.uniform(0.05, 0.5, (24, 3)))  # reach past the plane
    crossing = replace(crossing, opacity=rng.uniform(0.05, 0.4, 24))
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
    scene = replace(scene, position=scene.position - [0, 0, DEPTH] + FAR_PLACE)
    return scene
