"""Files of photographs: finding them by the name in a camera file, and reading their size."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

EXTENSIONS = ("", ".png", ".jpg", ".jpeg", ".JPG", ".PNG")
"""Extensions that may be missing from a file name in a transforms.json."""


def photograph_file(folder: Path, name: str) -> Path:
    """Find the photograph that a camera file names; `folder`/`name` if no file exists.

    Also tries missing extensions, and slashes instead of backslashes.
    """
    for text in (name, name.replace("\\", "/")):
        for extension in EXTENSIONS:
            if os.path.isfile(path := folder / (text + extension)):
                return path
    return folder / name


@contextmanager
def opened_photograph(path: Path) -> Iterator[Image.Image]:
    """Open a photograph without decoding it; lifts PIL's size limit meanwhile."""
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
