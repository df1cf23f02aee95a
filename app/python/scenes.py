"""Scenes, cameras and machines for Python programs: from files, by name, or from arrays."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from splatcore.app.python import check
from splatcore.model.cameras.view import sensible_view
from splatcore.model.formats.camera_file import read_cameras
from splatcore.sim.frame import source
from splatcore.sim.frame.reading import Reading
from splatcore.spec import camera as cameras
from splatcore.spec.camera import Camera
from splatcore.spec.colour import unfolded
from splatcore.spec.config import Config
from splatcore.spec.convention import COLOUR_OFFSET, NEAR_PLANE
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.preset import changed, find_preset
from splatcore.spec.scene import Scene, sh_count

DEGREES = (0, 1, 2, 3)


def open_scene(
    path: str | os.PathLike,
    antialiased: bool | None = None,
    axes: str | None = None,
    lod: int | None = None,
) -> Scene | PackedModel:
    """Open a scene or packed model.

    path: a scene file (3DGS PLY, compressed PLY, SPZ, glTF, USD, .splat, KSPLAT, SOG) or folder
        (SOG), a packed model (.splatcore), an output folder of INRIA's training, or the name of a
        generated scene ("garden" and those in `splatcore scene --help`) if no file has that name
    antialiased: override of the file's mark for opacity compensation; for scenes only
    axes: directions of x, y and z in an SPZ file that does not state them, like "rdf" (right, down,
        front, as in a PLY); None: "rub", the format's own, with a note
    lod: level of detail of a streamed SOG; None: 0, the finest

    Arrays of a `Scene`, float64:
        position [N, 3]: scene units
        scale [N, 3]: standard deviations, scene units
        quaternion [N, 4]: (w, x, y, z)
        opacity [N]: 0 … 1
        sh [N, (degree+1)², 3]: harmonics in the order of 3DGS
    Its `antialiased` is the mark, `mark` the reason for it, `notes` lists unusual contents.
    Raises InputError, naming the file and the field.
    """
    text = os.fspath(check.kind("path", path, str, os.PathLike))
    if antialiased is not None:
        check.kind("antialiased", antialiased, bool)
    if axes is not None:
        check.kind("axes", axes, str)
    if lod is not None:
        check.kind("lod", lod, int)
    found = source.open_source(text, Reading(antialiased, axes, lod))
    if antialiased is not None:
        return replace(found.scene, mark=f"antialiased={antialiased}")
    return found.scene if found.model is None else found.model


def make_scene(
    position: ArrayLike,
    scale: ArrayLike,
    quaternion: ArrayLike,
    opacity: ArrayLike,
    sh: ArrayLike | None = None,
    colour: ArrayLike | None = None,
    name: str = "scene",
    antialiased: bool = False,
) -> Scene:
    """Make a scene of N Gaussians from arrays, which are copied.

    position: [N, 3], scene units; y points down, as in 3DGS
    scale: [N, 3], standard deviations ≥ 0 in scene units, not their logarithms
    quaternion: [N, 4] (w, x, y, z), of any length
    opacity: [N], 0 … 1, not logits
    sh: [N, (degree+1)², 3], harmonics of degree 0 … 3 in the order of 3DGS; or instead
    colour: [N, 3], RGB, the same from every side
    antialiased: trained, and so rendered, with opacity compensation

    Raises InputError, naming the argument, for NaN, Inf, another shape or a value out of range.
    """
    position = check.array("position", position, (None, 3))
    count = len(position)
    scale = check.within("scale", check.array("scale", scale, (count, 3)), 0, np.inf)
    quaternion = check.array("quaternion", quaternion, (count, 4))
    opacity = check.within("opacity", check.array("opacity", opacity, (count,)), 0, 1)
    if (sh is None) == (colour is None):
        raise InputError("pass exactly one of sh and colour")
    if sh is None:
        sh = unfolded([check.array("colour", colour, (count, 3))[:, None] - COLOUR_OFFSET])
    sh = check.array("sh", sh, (count, None, 3))
    if sh.shape[1] not in map(sh_count, DEGREES):
        wanted = ", ".join(str(sh_count(degree)) for degree in DEGREES)
        raise InputError(f"sh: has {sh.shape[1]} harmonics, not one of {wanted}")
    mark = f"antialiased={antialiased}" if check.kind("antialiased", antialiased, bool) else ""
    return Scene(position, scale, quaternion, opacity, sh, name, (), antialiased, mark)


def open_cameras(
    path: str | os.PathLike | Scene | PackedModel,
    width: int | None = None,
    height: int | None = None,
    near: float = NEAR_PLANE,
) -> list[Camera]:
    """Open cameras; return at least one.

    path: one of
        INRIA's cameras.json, a transforms.json, a COLMAP model, or a folder with one: all cameras
        a path for `open_scene`: the cameras next to it, a generated scene's own, or a generated
            view
        a scene or model: a generated view
    width, height: pixels, both or neither; the intrinsics are scaled, each with its side. Neither:
        the cameras' own, which may exceed the limit of pictures; 1920 × 1080 for a generated view
    near: near plane of all cameras, scene units

    Raises InputError, naming file and camera.
    """
    check.kind("near", near, int, float, np.number)
    found = _open_cameras(path, width, height)
    return [replace(camera, near=near) for camera in found]


def _open_cameras(path, width: int | None, height: int | None) -> list[Camera]:
    """Open cameras with the default near plane."""
    if (width is None) != (height is None):
        raise InputError("pass both width and height, or neither")
    size = None if width is None else _size(width, height)
    if isinstance(path, Scene | PackedModel):
        return [sensible_view(path.gaussians(), *(size or source.VIEW_SIZE))]
    text = os.fspath(check.kind("path", path, str, os.PathLike, Scene, PackedModel))
    if file := source.camera_beside(text):
        found = read_cameras(file, size=size)
    elif _is_scene(text):
        opened = source.open_source(text)
        if opened.camera is None:
            return [sensible_view(opened.gaussians, *(size or source.VIEW_SIZE))]
        found = [opened.camera]
    else:
        found = read_cameras(text, size=size)
    return [camera.resized(*size) if size else camera for camera in found]


def _is_scene(text: str) -> bool:
    """Return whether a path names a scene or model, not cameras."""
    if os.path.isfile(text):
        return Path(text).suffix.lower() != ".json"
    return text in source.GENERATORS and not os.path.exists(text)


def _size(*sides: int) -> tuple[int, int]:
    """Return width and height; raise InputError unless both are integers in range."""
    for name, side in zip(("width", "height"), sides, strict=True):
        check.kind(name, side, int, np.integer)
        check.within(name, np.array(side), 1, cameras.SIZE_MAX)
    return int(sides[0]), int(sides[1])


def look_at(
    position: ArrayLike,
    target: ArrayLike,
    width: int = 1920,
    height: int = 1080,
    fov: float = 55.0,
    down: ArrayLike = (0.0, 1.0, 0.0),
    name: str = "",
) -> Camera:
    """Return a camera at `position` that looks at `target`.

    position, target: [3], scene units
    width, height: pixels
    fov: horizontal field of view in degrees, 0 … 180; pixels are square
    down: [3], direction of the image's +y; y points down in scenes of 3DGS

    To make a `Camera` from other numbers, pass it intrinsics in pixels and the transform from world
    to camera, in OpenCV axes. Raises InputError for NaN, sizes out of range, and coinciding
    directions.
    """
    eye, to = (check.array(n, v, (3,)) for n, v in (("position", position), ("target", target)))
    down = check.array("down", down, (3,))
    sides = _size(width, height)
    angle = float(check.within("fov", check.array("fov", fov, ()), 1e-3, 180 - 1e-3))
    if not (to - eye).any():
        raise InputError("target: is the camera's position")
    across = np.cross(down, to - eye)
    if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(down) * np.linalg.norm(to - eye):
        raise InputError("down: is parallel to the viewing direction")
    focal = sides[0] / (2 * np.tan(np.radians(angle) / 2))
    return cameras.look_at(eye, to, *sides, focal, down, name)


def preset(name: str | os.PathLike = "DEFAULT", **fields: object) -> Config:
    """Return a machine: a preset, with some fields changed.

    name: of a preset, like "DEFAULT", "PAPER" or "TINY", or a TOML file
    fields: of `Config`, like `preset("DEFAULT", rasterizers=2)`; the machine is then called "own"

    Raises InputError, naming the field, if it is unknown, or has a value that cannot be built.
    """
    config = find_preset(os.fspath(check.kind("name", name, str, os.PathLike)))
    return changed(config, fields) if fields else config
