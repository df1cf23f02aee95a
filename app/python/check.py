"""Checks of arguments of the Python API; each InputError names the argument."""

from collections.abc import Iterable, Sequence

import numpy as np

from splatcore.spec.camera import SIZE_MAX, Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.preset import check_buildable, find_preset
from splatcore.spec.scene import Scene

ROTATION_TOLERANCE = 1e-2
"""Largest entry of |R·Rᵀ − 1| at which a matrix still counts as a rotation."""


def array(name: str, value: object, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return a copy as float64; raise InputError for another shape, NaN or Inf.

    shape: required lengths; None: any length
    """
    try:
        found = np.array(value, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: is not an array of numbers") from None
    fits = zip(found.shape, shape, strict=False)
    if found.ndim != len(shape) or any(want not in (None, have) for have, want in fits):
        wanted = ", ".join("N" if n is None else str(n) for n in shape)
        raise InputError(f"{name}: has shape {found.shape}, not ({wanted})")
    if wrong := np.count_nonzero(~np.isfinite(found)):
        raise InputError(f"{name}: {wrong} of {found.size} values are NaN or infinite")
    return found


def within(name: str, values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the values; raise InputError if one is not in low … high."""
    if ((values < low) | (values > high)).any():
        wrong = values[(values < low) | (values > high)].flat[0]
        raise InputError(f"{name}: {wrong:g} is not in {low:g} … {high:g}")
    return values


def kind(name: str, value: object, *kinds: type) -> object:
    """Return the value; raise InputError unless it is of one of these classes."""
    if not isinstance(value, kinds):
        wanted = " or ".join(each.__name__ for each in kinds)
        raise InputError(f"{name}: is of type {type(value).__name__}, not {wanted}")
    return value


def machine(config: Config | str) -> Config:
    """Return a machine, given as such or by its preset's name; raise InputError for an impossible
    one."""
    found = find_preset(config) if isinstance(config, str) else kind("config", config, Config, str)
    check_buildable(found)
    return found


def view(camera: Camera) -> Camera:
    """Return the camera; raise InputError for a wrong rotation or size."""
    kind("camera", camera, Camera)
    for name in ("width", "height"):
        side = kind(f"camera: {name}", getattr(camera, name), int, np.integer)
        within(f"camera: {name}", np.array(side), 1, SIZE_MAX)
    rotation = camera.rotation
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if not (error <= ROTATION_TOLERANCE and np.linalg.det(rotation) > 0):
        raise InputError("camera: rotation is not a rotation matrix")
    return camera


def views(cameras: Sequence[Camera]) -> list[Camera]:
    """Return the cameras; raise InputError if they are no list, or for a wrong camera."""
    if not isinstance(cameras, Iterable):
        raise InputError(f"cameras: is of type {type(cameras).__name__}, not a list of Camera")
    return [view(each) for each in cameras]


def colour(name: str, value: Sequence[float]) -> tuple[float, float, float]:
    """Return red, green and blue; raise InputError unless each is in 0 … 1."""
    red, green, blue = within(name, array(name, value, (3,)), 0, 1)
    return float(red), float(green), float(blue)


def shown(scene: Scene | PackedModel) -> Scene | PackedModel:
    """Return the scene or model; raise InputError for anything else."""
    return kind("scene", scene, Scene, PackedModel)
