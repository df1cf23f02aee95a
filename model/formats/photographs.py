"""Photographs with their cameras, for training and fine-tuning."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from splatcore.model.formats.camera_file import camera_place, read_named
from splatcore.model.formats.file import input_error, reading
from splatcore.model.formats.photograph_file import opened_photograph, photograph_file
from splatcore.spec.camera import Camera

ASPECT_TOLERANCE = 1.0
"""Largest difference, in pixels, of a photograph's height from its camera's aspect ratio."""

UNKNOWN = (1, 1)
"""Size of a camera whose size would only be known from a missing photograph."""


@dataclass(frozen=True, eq=False)
class Target:
    """A camera and the picture to be reproduced from it."""

    camera: Camera
    image: np.ndarray  # uint8 [H, W, 3], of the camera's size
    name: str


@dataclass(frozen=True, eq=False)
class Photographs:
    """The photographs of a folder."""

    targets: tuple[Target, ...]  # by file name
    missing: tuple[str, ...]  # paths of photographs that cameras name but that cannot be read
    notes: tuple[str, ...]  # lines for the user


def read_photographs(path: str | os.PathLike, scale: float = 1.0) -> Photographs:
    """Read the photographs of a COLMAP model or a transforms.json.

    path: folder or file; COLMAP's photographs are in `images` next to or above the model
    scale: 0 … 1, shrinks photographs and cameras together

    If a photograph's size differs from its camera's, the camera is resized. A photograph named by
    two cameras belongs to the first. Pixels are used as stored, without EXIF rotation, as in
    COLMAP; transparent pixels are blended over black.

    Raises InputError if no photograph can be read, or if one has another aspect ratio than its
    camera.
    """
    if not 0 < scale <= 1:
        raise input_error("scale", f"{scale:g} is not in 0 … 1")
    place = camera_place(path)
    folder = _image_folder(place)
    targets, missing, resized = [], [], 0
    named = reversed(read_named(place, UNKNOWN))
    files = {photograph_file(folder, name): (name, camera) for camera, name in named}
    if folder in files:
        raise input_error(place, "a camera names no photograph")
    for file, (name, camera) in sorted(files.items(), key=lambda item: item[1][0]):
        try:
            with opened_photograph(file) as image:
                picture = _over_black(image)
        except (OSError, SyntaxError, ValueError):
            missing.append(str(file))
            continue
        camera = replace(camera, name=name)
        resized += picture.size != (camera.width, camera.height)
        targets.append(_target(camera, picture, file, scale))
    if not targets:
        why = f"none of its {len(missing)} photographs can be read" if missing else "has no images"
        raise input_error(place, why)
    notes = []
    if missing:
        some = ", ".join(missing[:3]) + (", …" if len(missing) > 3 else "")
        notes.append(f"{len(missing)} photographs are missing or broken and left out: {some}")
    if resized:
        notes.append(f"{resized} photographs have another size than their cameras say")
    return Photographs(tuple(targets), tuple(missing), tuple(notes))


def held_out(
    targets: Sequence[Target], every: int = 7
) -> tuple[tuple[Target, ...], tuple[Target, ...]]:
    """Split targets: those for training, and every `every`-th, from the first, for evaluation."""
    if every < 1:
        raise input_error("every", f"{every} is below 1")
    kept = tuple(target for number, target in enumerate(targets) if number % every)
    return kept, tuple(targets[::every])


def _image_folder(place: Path) -> Path:
    """The folder to which the cameras' file names are relative."""
    if not place.is_dir():
        return place.parent
    for folder in (place, *place.absolute().parents[:3]):
        if (folder / "images").is_dir():
            return folder / "images"
    raise input_error(place, "no folder `images` next to or above this COLMAP model")


def _over_black(image: Image.Image) -> Image.Image:
    """Convert to 8-bit RGB; transparent pixels are blended over black."""
    if image.mode.startswith("I;16"):
        image = Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    if image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info:
        image = image.convert("RGBA")
        black = Image.new("RGBA", image.size, (0, 0, 0, 255))
        image = Image.alpha_composite(black, image)
    return image.convert("RGB")


def _target(camera: Camera, picture: Image.Image, file: Path, scale: float) -> Target:
    """Scale a photograph and its camera; raises InputError if their aspect ratios differ.

    Each pixel is the mean of the pixels that it covers, as on a coarser sensor.
    """
    width, height = picture.size
    if abs(height - camera.height * width / camera.width) > ASPECT_TOLERANCE:
        sizes = f"{width}x{height}, but its camera {camera.width}x{camera.height}"
        raise input_error(file, f"is {sizes}: the aspect ratios differ")
    if picture.size != (camera.width, camera.height):
        with reading(file):
            camera = camera.resized(width, height)
    width, height = (max(round(side * scale), 1) for side in picture.size)
    if (width, height) != picture.size:
        picture = picture.resize((width, height), Image.Resampling.BOX)
    return Target(camera.resized(width, height), np.array(picture, np.uint8), camera.name)
