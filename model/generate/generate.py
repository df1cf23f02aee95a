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
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene

GARDEN_COUNT = 20_000  # Gaussians of the garden if no count is given
COUNT_MAX = 20_000_000  # most Gaussians of a generated scene
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


def garden(count: int = 20_000, seed: int = 0) -> Scene:
    """Generate a garden of exactly `count` Gaussians, SH degree 1, in the PLY frame of 3DGS.

    y points down, the ground is near y = 0, objects are within about 4 units of the origin, the sky
    is 160 units away. The result depends on (count, seed) only: each part uses
    numpy.random.default_rng([seed, index of the part]). The seed changes details, not the plan. The
    parts' shares are the same for every count; splats shrink as the count grows.

    Raises InputError for a count below 1 or a negative seed.
    """
    if count < 1:
        raise InputError(f"garden: count {count} is below 1")
    if seed < 0:
        raise InputError(f"garden: seed {seed} is below 0")
    counts = enumerate(part_counts(count).items())
    parts = [PARTS[name][0](np.random.default_rng([seed, k]), n) for k, (name, n) in counts if n]
    whole = join(parts)
    rotation, sh = quaternions(whole.frame), sh_coefficients(whole)
    return Scene(whole.position, whole.scale, rotation, whole.opacity, sh, name="garden")


def garden_camera(width: int = 960, height: int = 540) -> Camera:
    """A camera on the garden's path at eye height; about 58° wide at any size."""
    eye, target = np.array([0.3, -1.45, -5.5]), np.array([0.0, -1.08, 0.0])
    return look_at(eye, target, width, height, focal=0.9 * width, name="garden")


def generate(name: str, count: int | None = None, seed: int = 0) -> Scene:
    """Generate the scene `name`; the same arguments give the same arrays.

    count: number of Gaussians, 1 … 20 million; only for the garden

    Raises InputError for an unknown name, a count out of range or for another scene, and a negative
    seed.
    """
    _check_name(name)
    if count is not None and not 1 <= count <= COUNT_MAX:
        raise InputError(f"count: {count} is not in 1 … {COUNT_MAX}")
    if seed < 0:
        raise InputError(f"seed: {seed} is below 0")
    if name == "garden":
        return garden(GARDEN_COUNT if count is None else count, seed)
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
