"""Small camera files and captures for tests, written without the code in `model`."""

import json
import struct

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from splatcore.model.formats.colmap import MODELS
from splatcore.spec.camera import Camera, look_at

EXPECTED = [
    look_at([3, -1, 2], [0, 0.5, 0], 640, 480, 500.0, name="4"),
    look_at([-2, -2, -4], [0.3, 0, 0], 640, 480, 510.0, name="7"),
]
"""The cameras in all files below."""

POINT = struct.pack("<Q3d3BdQ", 1, 0.5, 0, 0, 9, 8, 7, 0.1, 0)


def inria() -> list[dict]:
    """Entries of a cameras.json: centre and camera-to-world rotation."""
    entries = []
    for camera in EXPECTED:
        entry = {"id": int(camera.name), "img_name": f"view {camera.name}.png"}
        entry |= {"width": camera.width, "height": camera.height}
        entry |= {"position": camera.position.tolist(), "rotation": camera.rotation.T.tolist()}
        entries.append(entry | {"fy": camera.fy, "fx": camera.fx})
    return entries


def transforms() -> dict:
    """A transforms.json in nerfstudio's format: camera to world, looking along −z, y up."""
    frames = []
    for camera in EXPECTED:
        matrix = np.eye(4)
        right, down, forward = camera.rotation
        matrix[:3] = np.stack([right, -down, -forward, camera.position], axis=1)
        path = f"images/view {camera.name}.png"
        frames.append({"file_path": path, "transform_matrix": matrix.tolist(), "fl_x": camera.fx})
    lens = {"camera_model": "OPENCV", "k1": 0.0, "k2": 0, "p1": 0, "p2": 0}
    return {"w": 640, "h": 480.0, "cx": 320.0, "cy": 240.0, **lens, "frames": frames}


def colmap_text(model: str = "PINHOLE", *numbers: float) -> dict[str, bytes]:
    """cameras.txt and images.txt; the second image comes first, the first one has no points.

    numbers: parameters of both cameras (default: those of `EXPECTED`)
    """
    cameras, images = "# comment\n", "# comment\n\n"
    for image, camera in reversed(list(zip((4, 7), EXPECTED, strict=True))):
        words = " ".join(map(repr, numbers or pinhole(camera, model == "SIMPLE_PINHOLE")))
        cameras += f"{image} {model} 640 480 {words}\n"
        pose = " ".join(map(repr, [*wxyz(camera), *camera.translation.tolist()]))
        points = "1.5 2.5 -1 3.5 4.5 9" if image == 7 else ""
        images += f"{image} {pose} {image} view {image}.png\n{points}\n"
    return {"cameras.txt": cameras.encode(), "images.txt": images.encode()}


def colmap_binary(model: int = 1, *numbers: float) -> dict[str, bytes]:
    """cameras.bin and images.bin of the same cameras."""
    cameras, images = struct.pack("<Q", 2), struct.pack("<Q", 2)
    for image, camera in reversed(list(zip((4, 7), EXPECTED, strict=True))):
        values = numbers or pinhole(camera, model == 0)
        cameras += struct.pack(f"<IiQQ{len(values)}d", image, model, 640, 480, *values)
        images += struct.pack("<I7dI", image, *wxyz(camera), *camera.translation, image)
        points = image - 4
        images += f"view {image}.png\0".encode() + struct.pack("<Q", points) + bytes(24 * points)
    return {"cameras.bin": cameras, "images.bin": images}


def pinhole(camera: Camera, one_focal: bool) -> list[float]:
    """A camera's focal lengths (or one of them) and principal point."""
    return [camera.fx, *([] if one_focal else [camera.fy]), 320, 240]


def wxyz(camera: Camera) -> list[float]:
    """Quaternion (w, x, y, z) of a camera's rotation."""
    return Rotation.from_matrix(camera.rotation).as_quat(scalar_first=True).tolist()


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
    return colmap_binary(MODELS.index(model), *numbers)
