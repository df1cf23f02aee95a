"""Writers of small captures for tests: COLMAP models, photographs, transforms.json."""

import json
import struct

from PIL import Image

from splatcore.model.formats.colmap import MODELS
from tb.helpers.camera_file import EXPECTED, colmap_binary, colmap_text

POINT = struct.pack("<Q3d3BdQ", 1, 0.5, 0, 0, 9, 8, 7, 0.1, 0)


def colmap(folder, files: dict[str, bytes]):
    """Write a COLMAP model with one point."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in (files | {"points3D.bin": struct.pack("<Q", 1) + POINT}).items():
        (folder / name).write_bytes(data)


def photographs(folder, size=(64, 48)):
    """Write the photographs of `EXPECTED`."""
    (folder / "images").mkdir(parents=True)
    for camera in EXPECTED:
        Image.new("RGB", size).save(folder / "images" / f"view {camera.name}.png")


def transforms_file(folder, value: dict, name: str = "transforms.json"):
    """Write a transforms.json; its path."""
    (folder / name).write_text(json.dumps(value))
    return folder / name


def lens(model: str, *numbers: float) -> dict[str, bytes]:
    """A binary COLMAP model whose cameras have these parameters."""
    files, code = colmap_binary(), MODELS.index(model)
    cameras = struct.pack("<Q", 2)
    for camera in (4, 7):
        cameras += struct.pack(f"<IiQQ{len(numbers)}d", camera, code, 640, 480, *numbers)
    return files | {"cameras.bin": cameras}


def text_lens(model: str, *numbers: float) -> dict[str, bytes]:
    words = " ".join(map(repr, numbers))
    lines = [f"{camera} {model} 640 480 {words}\n" for camera in (4, 7)]
    return colmap_text() | {"cameras.txt": "".join(lines).encode()}
