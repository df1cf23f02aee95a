"""The option --size: pixels of pictures, and cameras resized to it."""

import os
import re
from collections.abc import Sequence

from splatcore.model.formats.camera_file import read_cameras, size_file
from splatcore.sim.common import notes
from splatcore.spec.camera import SIZE_MAX, Camera
from splatcore.spec.error import InputError

STRETCH = 1.0
"""Rounding error in pixels by which a size may deviate from a camera's aspect ratio."""


def shape_of(size: str | None) -> tuple[int, int] | None:
    """Return width and height of --size, or None."""
    return parse_size(size) if size else None


def parse_size(text: str) -> tuple[int, int]:
    """Parse "WxH"; return width and height, each 1 … SIZE_MAX."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", text.strip())
    if not match:
        raise InputError(f"--size '{text}': is not WIDTHxHEIGHT, like 1920x1080")
    width, height = int(match[1]), int(match[2])
    for name, side in (("width", width), ("height", height)):
        if not 1 <= side <= SIZE_MAX:
            raise InputError(f"--size {text}: {name} {side} is not in 1 … {SIZE_MAX}")
    return width, height


def pictured(cameras: list[Camera], size: str | None, path: str) -> list[Camera]:
    """Return cameras resized to --size, if given.

    path: their file; a note names it if pictures are stretched
    Raises InputError, naming the file, for pictures above SIZE_MAX.
    """
    if shape := shape_of(size):
        note_stretched(cameras, shape, path)
        return [camera.resized(*shape) for camera in cameras]
    for camera in cameras:
        for name in ("width", "height"):
            if (side := getattr(camera, name)) > SIZE_MAX:
                which = f"{name} {side} of camera {camera.name}"
                where = size_file(path) if os.path.exists(path) else path
                raise InputError(f"{where}: {which} is not in 1 … {SIZE_MAX} (see --size)")
    return cameras


def note_stretched(cameras: Sequence[Camera], size: tuple[int, int], path: str):
    """Add a note if a size stretches the pictures of a file's cameras."""
    width, height = size

    def stretched(camera: Camera) -> bool:
        wrong = camera.width * height - camera.height * width  # 0 for the same shape
        return abs(wrong) > STRETCH * max(camera.width, camera.height)

    if found := [camera for camera in cameras if stretched(camera)]:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        shapes = f"{found[0].width}x{found[0].height} is stretched to {width}x{height} (--size)"
        notes.add(f"{path}: camera {found[0].name}{more}: {shapes}, fx and fy are scaled apart")


def path_cameras(path: str, size: str) -> list[Camera]:
    """Read all cameras of a file or folder, resized to --size."""
    return pictured(read_cameras(path, size=parse_size(size)), size, path)
