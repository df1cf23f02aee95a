"""Cameras and points of a COLMAP model: `cameras`, `images`, `points3D`, binary or text.

Source: COLMAP documentation, "Output Format". COLMAP's axes and its pixel centres at half
integers are those of `Camera`.
"""

import os
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from splatcore.model.formats.file import input_error, read_bytes, reading
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import rotation_matrix

MODELS = (
    "SIMPLE_PINHOLE PINHOLE SIMPLE_RADIAL RADIAL OPENCV OPENCV_FISHEYE FULL_OPENCV FOV "
    "SIMPLE_RADIAL_FISHEYE RADIAL_FISHEYE THIN_PRISM_FISHEYE"
).split()
"""Camera models by their number in a binary file."""

PARAMETERS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4}
"""The models without distortion → their parameters: f or fx, fy, then cx, cy."""

POINT = struct.Struct("<Q3d3BdQ")
"""A point: id, x, y, z, r, g, b, error, images that show it; 8 bytes for each of these follow."""

SHOWN = 8  # bytes for each image that shows a point

Points = tuple[np.ndarray, np.ndarray]
"""Positions [N, 3] (float64, scene units) and colours [N, 3] (uint8)."""

Intrinsics = tuple[int, int, float, float, float, float]  # width, height, fx, fy, cx, cy in pixels


def colmap_folder(path: str | os.PathLike) -> Path:
    """The folder of the model: `path` itself, `path`/0 or `path`/sparse/0."""
    for folder in (Path(path), Path(path, "0"), Path(path, "sparse", "0")):
        if any((folder / f"cameras{extension}").is_file() for extension in (".bin", ".txt")):
            return folder
    raise input_error(path, "no cameras.bin or cameras.txt in it, its 0 or its sparse/0")


def read_colmap(path: str | os.PathLike) -> list[tuple[Camera, str]]:
    """Each image's camera and file name, by ascending image id."""
    folder = colmap_folder(path)
    extension, read_intrinsics, read_images = ".txt", _text_cameras, _text_images
    if (folder / "cameras.bin").is_file():
        extension, read_intrinsics, read_images = ".bin", _binary_cameras, _binary_images
    cameras_path, images_path = folder / f"cameras{extension}", folder / f"images{extension}"
    intrinsics, cameras = read_intrinsics(cameras_path), {}
    for image, pose, camera, name in read_images(images_path):
        where = f"{images_path}: image {image}"
        if camera not in intrinsics:
            raise input_error(where, f"camera {camera} is not in {cameras_path.name}")
        if image in cameras:
            raise input_error(where, "occurs twice")
        cameras[image] = _camera(image, pose, intrinsics[camera], where), name
    if not cameras:
        raise input_error(images_path, "holds no images")
    return [cameras[image] for image in sorted(cameras)]


def _camera(image: int, pose: tuple[float, ...], intrinsics: Intrinsics, where: str) -> Camera:
    """A camera from the pose (qw, qx, qy, qz, tx, ty, tz), world to camera."""
    quaternion = np.array(pose[:4])
    with np.errstate(over="ignore", invalid="ignore"):
        norm = np.linalg.norm(quaternion)
        if not (np.isfinite(norm) and norm > 0):
            raise input_error(where, f"quaternion {pose[:4]} has no direction")
        rotation = rotation_matrix(quaternion[None] / norm)[0]
    try:
        return Camera(*intrinsics, rotation, pose[4:], str(image))
    except InputError as error:
        raise input_error(where, error) from error


def _intrinsics(model: str, size: tuple[int, int], numbers: list[float], where: str) -> Intrinsics:
    """Intrinsics of a pinhole model from its parameters."""
    if model not in PARAMETERS:
        raise input_error(where, f"model {model} is not supported, only PINHOLE, SIMPLE_PINHOLE")
    if len(numbers) != PARAMETERS[model]:
        raise input_error(where, f"{model} has {len(numbers)} parameters")
    *focal, cx, cy = numbers
    return *size, focal[0], focal[-1], cx, cy


def _binary_cameras(path: Path) -> dict[int, Intrinsics]:
    """cameras.bin: count, then id, model, width, height, parameters of each camera."""
    data = read_bytes(path)
    cameras = {}
    with reading(path, "is cut off"):
        (count,) = struct.unpack_from("<Q", data)
        offset = 8
        for _ in range(count):
            camera, model, *size = struct.unpack_from("<IiQQ", data, offset)
            name = MODELS[model] if 0 <= model < len(MODELS) else str(model)
            layout = f"<{PARAMETERS.get(name, 0)}d"
            numbers = list(struct.unpack_from(layout, data, offset + 24))
            cameras[camera] = _intrinsics(name, tuple(size), numbers, f"{path}: camera {camera}")
            offset += 24 + struct.calcsize(layout)
    return cameras


def _binary_images(path: Path) -> Iterator[tuple[int, tuple[float, ...], int, str]]:
    """images.bin: count, then id, pose, camera id, name, count of points and 24 bytes for each."""
    data = read_bytes(path)
    with reading(path, "is cut off"):
        (count,) = struct.unpack_from("<Q", data)
        offset = 8
        for _ in range(count):
            image, *pose, camera = struct.unpack_from("<I7dI", data, offset)
            end = data.index(b"\0", offset + 64)
            name = data[offset + 64 : end].decode("utf-8", "replace")
            (points,) = struct.unpack_from("<Q", data, end + 1)
            offset = end + 9 + 24 * points
            if offset > len(data):
                raise input_error(path, f"image {image}: {points} points in {len(data)} bytes")
            yield image, tuple(pose), camera, name


def text_lines(path: Path) -> list[str]:
    """Lines of a text file, comments left out; empty lines stay: an image may have no points."""
    text = read_bytes(path).decode("utf-8", "replace")
    return [line for line in text.split("\n") if not line.startswith("#")]


def _text_cameras(path: Path) -> dict[int, Intrinsics]:
    """cameras.txt: id, model, width, height, parameters."""
    cameras = {}
    for words in filter(None, map(str.split, text_lines(path))):
        where = f"{path}: camera {words[0][:40]}"
        with reading(where, "line is malformed"):
            camera, size = int(words[0]), (int(words[2]), int(words[3]))
            numbers = [float(word) for word in words[4:]]
            cameras[camera] = _intrinsics(words[1][:40], size, numbers, where)
    return cameras


def _text_images(path: Path) -> Iterator[tuple[int, tuple[float, ...], int, str]]:
    """images.txt: a line of id, pose, camera id, name, then a line of points, for each image."""
    lines = iter(text_lines(path))
    for line in lines:
        words = line.split(maxsplit=9)
        if not words:
            continue
        with reading(f"{path}: image {words[0][:40]}", "line is malformed"):
            pose = tuple(float(word) for word in words[1:8])
            image = int(words[0]), pose, int(words[8]), words[9].strip()
        yield image
        next(lines, None)


def read_points(path: str | os.PathLike) -> Points:
    """The points of a COLMAP folder (or the one above); InputError names the file and the point."""
    folder = colmap_folder(path)
    for name, reader in (("points3D.bin", _binary_points), ("points3D.txt", _text_points)):
        if (folder / name).is_file():
            position, colour = reader(folder / name)
            break
    else:
        raise input_error(folder, "has no points3D.bin or points3D.txt")
    if not len(position):
        raise input_error(folder / name, "holds no points")
    wrong = np.flatnonzero(~np.isfinite(position).all(axis=1))
    if len(wrong):
        raise input_error(folder / name, f"point {wrong[0]} is not finite")
    return position, colour


def _binary_points(path: Path) -> Points:
    data = read_bytes(path)
    position, colour = [], []
    with reading(path, "is cut off"):
        (count,) = struct.unpack_from("<Q", data)
        offset = 8
        for number in range(count):
            _, x, y, z, red, green, blue, _, shown = POINT.unpack_from(data, offset)
            offset += POINT.size + SHOWN * shown
            if offset > len(data):
                raise input_error(path, f"point {number}: {shown} images in {len(data)} bytes")
            position.append((x, y, z))
            colour.append((red, green, blue))
    return np.array(position).reshape(-1, 3), np.array(colour, np.uint8).reshape(-1, 3)


def _text_points(path: Path) -> Points:
    """Lines of id, x, y, z, r, g, b, error, images."""
    rows = []
    for number, words in enumerate(line.split() for line in text_lines(path)):
        if not words:
            continue
        with reading(f"{path}: point {number}", "line is malformed"):
            rows.append([float(word) for word in words[1:7]])
            if len(rows[-1]) != 6 or not all(0 <= value <= 255 for value in rows[-1][3:]):
                raise ValueError("not x, y, z and a colour")
    table = np.array(rows).reshape(-1, 6)
    return table[:, :3], table[:, 3:].astype(np.uint8)
