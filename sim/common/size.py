"""The argument --size: pixels of pictures, and cameras with so many."""

import os
import re
from collections.abc import Sequence

from splatcore.model.formats.camera_file import read_cameras, size_file
from splatcore.sim.common import notes
from splatcore.spec.camera import SIZE_MAX, Camera
from splatcore.spec.error import InputError

STRETCH = 1.0
"""Pixels, of the side where it counts less, by which a size may miss a camera's shape: rounding."""


def shape_of(size: str | None) -> tuple[int, int] | None:
    """Width and height of --size, if it is given."""
    return parse_size(size) if size else None


def parse_size(text: str) -> tuple[int, int]:
    """Width and height of "WxH", each 1 … SIZE_MAX."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", text.strip())
    if not match:
        raise InputError(f"--size '{text}': is not WIDTHxHEIGHT, like 1920x1080")
    width, height = int(match[1]), int(match[2])
    for name, side in (("width", width), ("height", height)):
        if not 1 <= side <= SIZE_MAX:
            raise InputError(f"--size {text}: {name} {side} is not in 1 … {SIZE_MAX}")
    return width, height


def pictured(cameras: list[Camera], size: str | None, path: str) -> list[Camera]:
    """Cameras of a file, with the pixels of --size if it is given. A line on standard error says
    so if that stretches pictures. InputError, naming the file, for pictures above SIZE_MAX."""
    if shape := shape_of(size):
        note_stretched(cameras, shape, path)
        return [camera.resized(*shape) for camera in cameras]
    for camera in cameras:
        for name in ("width", "height"):
            if (side := getattr(camera, name)) > SIZE_MAX:
                what = f"{name} {side} of camera {camera.name}"
                where = size_file(path) if os.path.exists(path) else path
                raise InputError(f"{where}: {what} is not in 1 … {SIZE_MAX} (see --size)")
    return cameras


def note_stretched(cameras: Sequence[Camera], size: tuple[int, int], path: str):
    """Say on standard error, in one line, that a size stretches pictures of a file's cameras."""
    width, height = size

    def stretched(camera: Camera) -> bool:
        wrong = camera.width * height - camera.height * width  # 0 for the same shape
        return abs(wrong) > STRETCH * max(camera.width, camera.height)

    if found := [camera for camera in cameras if stretched(camera)]:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        shapes = f"{found[0].width}x{found[0].height} is stretched to {width}x{height} (--size)"
        notes.tell(f"{path}: camera {found[0].name}{more}: {shapes}, fx and fy are scaled apart")


def path_cameras(path: str, size: str) -> list[Camera]:
    """All cameras of a file or folder, with the pixels of --size."""
    return pictured(read_cameras(path, size=parse_size(size)), size, path)
