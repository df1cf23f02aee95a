"""Generated scenes by name: the garden of any size and the hard cases."""

from dataclasses import replace

from splatcore.model.generate.garden import garden, garden_camera
from splatcore.model.generate.hard import HARD
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import Scene

GARDEN_COUNT = 20_000
"""Gaussians of the garden if no count is given."""

COUNT_MAX = 20_000_000
"""Most Gaussians of a generated scene."""


def _garden(count: int | None, seed: int) -> Scene:
    return garden(GARDEN_COUNT if count is None else count, seed)


def _hard(name: str):
    def build(count: int | None, seed: int) -> Scene:
        if count is not None:
            raise InputError(f"count: the scene {name!r} has a fixed number of Gaussians")
        return HARD[name](seed).scene

    return build


GENERATORS = {"garden": _garden} | {name: _hard(name) for name in HARD}
"""Name → function of (count or None, seed)."""


def generate(name: str, count: int | None = None, seed: int = 0) -> Scene:
    """The generated scene `name`, with its name set; the same arguments give the same arrays.

    Raises InputError for an unknown name, a count that is not in 1 … 20 million or that the
    scene does not take, and a negative seed.
    """
    _check_name(name)
    if count is not None and not 1 <= count <= COUNT_MAX:
        raise InputError(f"count: {count} is not in 1 … {COUNT_MAX}")
    if seed < 0:
        raise InputError(f"seed: {seed} is not ≥ 0")
    return replace(GENERATORS[name](count, seed), name=name)


def generated_camera(name: str, width: int | None = None, height: int | None = None) -> Camera:
    """The camera that goes with the generated scene `name`.

    Without a size it is the scene's own (960×540 for the garden); another size shows the same
    view, scaled. Raises InputError for an unknown name or a size out of range.
    """
    _check_name(name)
    camera = garden_camera() if name == "garden" else HARD[name](0).camera
    if width is None and height is None:
        return replace(camera, name=name)
    width = camera.width if width is None else width
    height = camera.height if height is None else height
    return replace(camera.resized(width, height), name=name)


def _check_name(name: str) -> None:
    if name not in GENERATORS:
        raise InputError(f"no generated scene {name!r}; there are {', '.join(GENERATORS)}")
