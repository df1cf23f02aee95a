"""Common parts of the hard cases: their table, the camera, Gaussians spread over a view."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from splatcore.spec.camera import Camera
from splatcore.spec.colour import SH_C0
from splatcore.spec.convention import COLOUR_OFFSET
from splatcore.spec.scene import ARRAYS, Scene

WIDTH, HEIGHT = 64, 48
"""Picture size of most hard cases, pixels: few tiles, so that RTL simulation takes minutes."""

FOCAL = 64.0  # pixels; a power of two, so that pixel centres have exact world coordinates
DEPTH = 4.0  # default depth of Gaussians, scene units
TILE_CORNER = 16  # cases of a single tile fill the tile with the first pixel (16, 16)

PSNR_MIN = 52.0
"""Minimum PSNR, dB, of a machine's 8-bit picture against the reference on the same packed model,
which applies the machine's faintness rule."""


@dataclass(frozen=True, eq=False)
class HardCase:
    """A scene with a corner case that renderers may get wrong, and the camera that shows it."""

    scene: Scene
    camera: Camera
    about: str  # the corner case and why it is hard, one line
    packing_db: float | None = None  # minimum PSNR after packing, dB against the scene, if bounded


HARD: dict[str, Callable[[int], HardCase]] = {}
"""Name → function of a seed that returns the case, deterministically."""


def straight_camera(width: int = WIDTH, height: int = HEIGHT) -> Camera:
    """A camera at the origin, looking along +z: camera space is world space, bit for bit."""
    eye, origin = np.eye(3), np.zeros(3)
    return Camera(width, height, FOCAL, FOCAL, width / 2, height / 2, eye, origin, "straight")


def hard_case(
    about: str, camera: Camera | None = None, packing_db: float | None = None
) -> Callable:
    """Decorator: enter a function of a random generator that returns a scene as a hard case."""

    def enter(build: Callable[[np.random.Generator], Scene]) -> Callable[[int], HardCase]:
        def case(seed: int = 0) -> HardCase:
            scene = build(np.random.default_rng(seed))
            return HardCase(scene, camera or straight_camera(), about, packing_db)

        HARD[build.__name__] = case
        return case

    return enter


def behind_pixel(u: np.ndarray, v: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """World points [N, 3] that the 64×48 straight camera sees at pixel (u, v) and `depth`."""
    u, v, depth = np.broadcast_arrays(*(np.asarray(a, np.float64) for a in (u, v, depth)))
    x = (u + 0.5 - WIDTH / 2) / FOCAL * depth
    y = (v + 0.5 - HEIGHT / 2) / FOCAL * depth
    return np.stack([x, y, depth], axis=1)


def sh_of_colour(colour: np.ndarray) -> np.ndarray:
    """SH [N, 4, 3] of degree 1 that shows `colour` [N, 3] from everywhere."""
    sh = np.zeros((len(colour), 4, 3))
    sh[:, 0] = (np.asarray(colour) - COLOUR_OFFSET) / SH_C0
    return sh


def spread(rng: np.random.Generator, count: int, depth=DEPTH, pixels=(0.5, 4.0)) -> Scene:
    """Ordinary Gaussians all over the view of the 64×48 straight camera.

    depth: number or [count], scene units
    pixels: range of the standard deviations on screen
    """
    depth = np.broadcast_to(np.asarray(depth, np.float64), count)
    u, v = rng.uniform(0, WIDTH - 1, count), rng.uniform(0, HEIGHT - 1, count)
    sh = sh_of_colour(rng.uniform(0.05, 0.95, (count, 3)))
    sh[:, 1:] = rng.normal(0, 0.1, (count, 3, 3))
    place, scale = behind_pixel(u, v, depth), rng.uniform(*pixels, (count, 3)) * depth[:, None]
    quaternion, opacity = rng.standard_normal((count, 4)), rng.uniform(0.1, 0.99, count)
    return Scene(place, scale / FOCAL, quaternion, opacity, sh)


def in_one_tile(rng: np.random.Generator, scene: Scene, depth: np.ndarray) -> Scene:
    """Move the centres of a scene's Gaussians into the tile at (16, 16), at `depth` [N]."""
    u, v = rng.uniform(TILE_CORNER, TILE_CORNER + 15, (2, len(scene)))
    return replace(scene, position=behind_pixel(u, v, depth))


def together(*scenes: Scene) -> Scene:
    """Join the Gaussians of scenes, in order; SH degrees and marks must be equal."""
    joined = {name: np.concatenate([getattr(s, name) for s in scenes]) for name in ARRAYS}
    return replace(scenes[0], **joined)
