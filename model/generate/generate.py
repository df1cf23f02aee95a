"""Generated scenes by name: the garden and the hard cases.

The garden is the project's own test scene: a small outdoor scene of any number of Gaussians.
"""

from dataclasses import replace

import numpy as np

from splatcore.model.generate.garden_flowers import flowers
from splatcore.model.generate.garden_ground import ground, hills, path, sky
from splatcore.model.generate.garden_light import sh_coefficients
from splatcore.model.generate.garden_objects import bench, bird_bath, fence
from splatcore.model.generate.garden_plants import bushes, far_trees, grass, tree
from splatcore.model.generate.garden_splats import join, quaternions, share_out
from splatcore.model.generate.hard import HARD
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.convention import SH_DEGREE_MAX
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene, batches

GARDEN_COUNT = 20_000  # Gaussians of the garden if no count is given
COUNT_MAX = 20_000_000  # most Gaussians of a generated scene
SPREAD = np.array([0.03, 0.015])  # standard deviations of random harmonics of degree 2 and 3
GENERATORS = ("garden", *HARD)  # names of the generated scenes

PARTS = {
    "grass": (grass, 0.20),
    "tree": (tree, 0.19),
    "flowers": (flowers, 0.135),
    "ground": (ground, 0.085),
    "bushes": (bushes, 0.105),
    "path": (path, 0.07),
    "fence": (fence, 0.07),
    "bench": (bench, 0.03),
    "bird_bath": (bird_bath, 0.03),
    "far_trees": (far_trees, 0.035),
    "sky": (sky, 0.04),
    "hills": (hills, 0.010),
}
"""Part → (function of a random generator and a count, share of the Gaussians), in storage order."""


def part_counts(count: int) -> dict[str, int]:
    """Part of the garden → its number of Gaussians, of `count` in all, in storage order."""
    return dict(zip(PARTS, share_out(count, [s for _, s in PARTS.values()]).tolist(), strict=True))


def garden(count: int = 20_000, seed: int = 0, sh_degree: int = 1) -> Scene:
    """Generate a garden of exactly `count` Gaussians in the PLY frame of 3DGS.

    y points down, the ground is near y = 0, objects are within about 4 units of the origin, the sky
    is 160 units away. The result depends on the arguments only: each part uses
    numpy.random.default_rng([seed, index of the part]). The seed changes details, not the plan. The
    parts' shares are the same for every count; splats shrink as the count grows. Harmonics of
    degree 2 and 3 are random and small (`SPREAD`), those of the sky are 0; with them `sh` is
    float32.

    Raises InputError for a count below 1, a negative seed or another degree than 0 … 3.
    """
    if count < 1:
        raise InputError(f"garden: count {count} is below 1")
    if seed < 0:
        raise InputError(f"garden: seed {seed} is below 0")
    if not 0 <= sh_degree <= SH_DEGREE_MAX:
        raise InputError(f"sh-degree: {sh_degree} is not in 0 … {SH_DEGREE_MAX}")
    sizes = part_counts(count)
    random = {name: np.random.default_rng([seed, index]) for index, name in enumerate(sizes)}
    whole = join((PARTS[name][0](random[name], n) for name, n in sizes.items() if n), count)
    sh, start = sh_coefficients(whole, sh_degree), 0
    for name, n in sizes.items() if sh_degree > 1 else ():
        for rows in batches(n):
            place = slice(start + rows.start, start + rows.stop)
            sh[place, 4:] = _higher(random[name], sh_degree, whole.glow[place])
        start += n
    rotation = quaternions(whole.frame)
    return Scene(whole.position, whole.scale, rotation, whole.opacity, sh, name="garden")


def _higher(rng: np.random.Generator, degree: int, glow: np.ndarray) -> np.ndarray:
    """Random SH coefficients [N, (degree+1)² − 4, 3] above degree 1; 0 for splats that glow."""
    spread = np.repeat(SPREAD[: degree - 1], [5, 7][: degree - 1])[:, None]
    draw = rng.standard_normal((len(glow), len(spread), 3), np.float32)
    return draw * spread * ~glow[:, None, None]


def garden_camera(width: int = 960, height: int = 540) -> Camera:
    """A camera on the garden's path at eye height; about 58° wide at any size."""
    eye, target = np.array([0.3, -1.45, -5.5]), np.array([0.0, -1.08, 0.0])
    return look_at(eye, target, width, height, focal=0.9 * width, name="garden")


def generate(
    name: str, count: int | None = None, seed: int = 0, sh_degree: int | None = None
) -> Scene:
    """Generate the scene `name`; the same arguments give the same arrays.

    count: number of Gaussians, 1 … 20 million; only for the garden
    sh_degree: 0 … 3 (default: 1); only for the garden

    Raises InputError for an unknown name, a count or degree out of range or for another scene, and
    a negative seed.
    """
    _check_name(name)
    if count is not None and not 1 <= count <= COUNT_MAX:
        raise InputError(f"count: {count} is not in 1 … {COUNT_MAX}")
    if seed < 0:
        raise InputError(f"seed: {seed} is below 0")
    if name == "garden":
        degree = 1 if sh_degree is None else sh_degree
        return garden(GARDEN_COUNT if count is None else count, seed, degree)
    if sh_degree is not None:
        raise InputError(f"sh-degree: the scene {name!r} has harmonics of its own")
    if count is not None:
        raise InputError(f"count: the scene {name!r} has a fixed number of Gaussians")
    return replace(HARD[name](seed).scene, name=name)


def generated_camera(name: str, width: int | None = None, height: int | None = None) -> Camera:
    """The camera of the generated scene `name`.

    width, height: pixels (default: the scene's own size, 960×540 for the garden); another size
        shows the same view, scaled
    Raises InputError for an unknown name or a size out of range.
    """
    _check_name(name)
    camera = garden_camera() if name == "garden" else HARD[name](0).camera
    if width is not None or height is not None:
        width = camera.width if width is None else width
        camera = camera.resized(width, camera.height if height is None else height)
    return replace(camera, name=name)


def _check_name(name: str) -> None:
    if name not in GENERATORS:
        raise InputError(f"no generated scene {name!r}; choose one of {', '.join(GENERATORS)}")
