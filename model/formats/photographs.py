"""Photographs with the cameras that took them, to train a scene on or to fine-tune it to."""

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
"""Pixels by which a photograph's height may differ from what its camera's aspect ratio says."""

UNKNOWN = (1, 1)
"""Stands for the size of a camera that only a missing photograph would say."""


@dataclass(frozen=True, eq=False)
class Target:
    """A camera and the picture that it should see."""

    camera: Camera
    image: np.ndarray  # uint8 [H, W, 3], of the camera's size
    name: str


@dataclass(frozen=True, eq=False)
class Photographs:
    """The readable photographs of a folder; `notes` are lines for the user."""

    targets: tuple[Target, ...]  # by file name
    missing: tuple[str, ...]  # paths of those that cameras name and that cannot be read
    notes: tuple[str, ...]


def read_photographs(path: str | os.PathLike, scale: float = 1.0) -> Photographs:
    """Photographs of a COLMAP folder (in `images` beside or above the model) or a transforms.json.

    `scale` (0 … 1) shrinks photograph and camera together. A photograph may have any size. One that
    is larger or smaller than its camera says gets a camera of its size, if the aspect ratio is the
    same; else InputError names it and both sizes. One that is not there is counted in `missing`;
    InputError if none is there. One that two cameras name counts for the first of them. Pixels are
    taken as they are stored, whatever the EXIF orientation says, as COLMAP does; what is
    transparent is shown over black.
    """
    if not 0 < scale <= 1:
        raise input_error("scale", f"{scale:g} is not in 0 … 1")
    place = camera_place(path)
    folder = _image_folder(place)
    targets, missing, resized = [], [], 0
    named = reversed(read_named(place, UNKNOWN))
    files = {photograph_file(folder, name): (name, camera) for camera, name in named}
    if folder in files:
        raise input_error(place, "a camera has no photograph's name")
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
        notes.append(f"{resized} photographs are of another size than their cameras say")
    return Photographs(tuple(targets), tuple(missing), tuple(notes))


def held_out(
    targets: Sequence[Target], every: int = 7
) -> tuple[tuple[Target, ...], tuple[Target, ...]]:
    """Targets to learn from, and every `every`-th one, beginning with the first, to judge by."""
    if every < 1:
        raise input_error("every", f"{every} is below 1")
    kept = tuple(target for number, target in enumerate(targets) if number % every)
    return kept, tuple(targets[::every])


def _image_folder(place: Path) -> Path:
    """The folder at which the file names of the cameras begin."""
    if not place.is_dir():
        return place.parent
    for folder in (place, *place.absolute().parents[:3]):
        if (folder / "images").is_dir():
            return folder / "images"
    raise input_error(place, "there is no folder `images` beside or above this COLMAP model")


def _over_black(image: Image.Image) -> Image.Image:
    """RGB; what is transparent shows black, and 16 bits of grey become 8."""
    if image.mode.startswith("I;16"):
        image = Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    if image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info:
        image = image.convert("RGBA")
        black = Image.new("RGBA", image.size, (0, 0, 0, 255))
        image = Image.alpha_composite(black, image)
    return image.convert("RGB")


def _target(camera: Camera, picture: Image.Image, file: Path, scale: float) -> Target:
    """The photograph, and a camera of its size, at `scale`; InputError if that is another view.

    Each pixel is the mean of those it covers, as a sensor's would be.
    """
    width, height = picture.size
    if abs(height - camera.height * width / camera.width) > ASPECT_TOLERANCE:
        sizes = f"{width}x{height} and its camera {camera.width}x{camera.height}"
        raise input_error(file, f"is {sizes}: not the same view")
    if picture.size != (camera.width, camera.height):
        with reading(file):
            camera = camera.resized(width, height)
    width, height = (max(round(side * scale), 1) for side in picture.size)
    if (width, height) != picture.size:
        picture = picture.resize((width, height), Image.Resampling.BOX)
    return Target(camera.resized(width, height), np.array(picture, np.uint8), camera.name)
