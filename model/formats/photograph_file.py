"""Files of photographs: where the name in a camera file leads, and the size of the picture."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

EXTENSIONS = ("", ".png", ".jpg", ".jpeg", ".JPG", ".PNG")
"""Extensions that a file name in a transforms.json may lack."""


def photograph_file(folder: Path, name: str) -> Path:
    """The photograph that a camera file names, with an extension if the name lacks it; a backslash
    is a slash where no file has such a name. `folder`/`name` if there is no file."""
    for text in (name, name.replace("\\", "/")):
        for extension in EXTENSIONS:
            if os.path.isfile(path := folder / (text + extension)):
                return path
    return folder / name


@contextmanager
def opened_photograph(path: Path) -> Iterator[Image.Image]:
    """A photograph of any size, not yet decoded; the library's own limit does not count."""
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(path) as image:
            yield image
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def photograph_size(path: Path) -> tuple[int, int] | None:
    """Width and height of a photograph; None if it cannot be read."""
    try:
        with opened_photograph(path) as image:
            return image.size
    except (OSError, SyntaxError, ValueError):
        return None
