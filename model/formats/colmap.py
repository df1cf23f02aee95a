"""Cameras and points of a COLMAP model: `cameras`, `images`, `points3D`, binary or text.

Source: COLMAP documentation, "Output Format". `Camera` has the same axes and, like COLMAP, pixel
centres at half integers.
"""

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from splatcore.model.formats.file import input_error, read_bytes, reading
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError
from splatcore.spec.scene import rotation_matrix

LENSES = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": "fx fy cx cy omega",
    "SIMPLE_RADIAL_FISHEYE": "",
    "RADIAL_FISHEYE": "",
    "THIN_PRISM_FISHEYE": "",
    "RAD_TAN_THIN_PRISM_FISHEYE": "",
    "SIMPLE_DIVISION": "f cx cy k",
    "DIVISION": "fx fy cx cy k",
    "SIMPLE_FISHEYE": "",
    "FISHEYE": "",
    "EUCM": "fx fy cx cy alpha beta",
    "EQUIRECTANGULAR": "",
}
"""Camera models, in the order of their numbers in a binary file → their parameters; "" for models
that are not pinholes even with all distortion coefficients 0."""

MODELS = tuple(LENSES)

UNDISTORTED = ("f", "fx", "fy", "cx", "cy", "beta")  # beta only scales the effect of alpha
"""Parameters that are not distortion coefficients."""

FOLDERS = ("", "0", "sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse", "colmap")
"""Subfolders that may hold a model; COLMAP's image_undistorter writes `sparse`, nerfstudio
`colmap/sparse/0`."""

POINTS = re.compile(r"(?:\s*[-+.\deEnaif]+\s+[-+.\deEnaif]+\s+-?\d+(?=\s|$))*\s*")
"""A line of an image's points: x, y and index of each point, or nothing."""

POINT = struct.Struct("<Q3d3BdQ")
"""A point: id, x, y, z, r, g, b, error, number of images that show it; SHOWN bytes per image
follow."""

SHOWN = 8  # bytes per image that shows a point

Points = tuple[np.ndarray, np.ndarray]
"""Positions [N, 3] (float64, scene units) and colours [N, 3] (uint8)."""

Lens = tuple[int, str, tuple[int, int], list[float]]  # id, model, width and height, parameters


def find_colmap(path: str | os.PathLike) -> Path | None:
    """The folder of a model: the first of `FOLDERS` in `path` with a file of cameras, or None."""
    for folder in (Path(path, place) for place in FOLDERS):
        if any((folder / f"cameras{extension}").is_file() for extension in (".bin", ".txt")):
            return folder
    return None


def colmap_folder(path: str | os.PathLike) -> Path:
    """The folder of a model (see `find_colmap`); raises InputError if there is none."""
    if folder := find_colmap(path):
        return folder
    places = ", ".join(filter(None, FOLDERS))
    raise input_error(path, f"no cameras.bin or cameras.txt in it or in its folders {places}")


def cameras_file(folder: Path) -> Path:
    """The file of cameras in the folder of a model; the binary one if both exist."""
    binary = folder / "cameras.bin"
    return binary if binary.is_file() else folder / "cameras.txt"


def read_colmap(path: str | os.PathLike) -> list[tuple[Camera, str]]:
    """Read each image's camera and file name, by ascending image id."""
    cameras_path = cameras_file(colmap_folder(path))
    images_path = cameras_path.with_stem("images")
    read_lenses, read_images = _text_cameras, _text_images
    if cameras_path.suffix == ".bin":
        read_lenses, read_images = _binary_cameras, _binary_images
    lenses, cameras = {}, {}
    for camera, model, size, numbers in read_lenses(cameras_path):
        where = f"{cameras_path}: camera {camera}"
        if camera in lenses:
            raise input_error(where, "occurs twice")
        lenses[camera] = _lens(model, size, numbers, where)
    for image, pose, camera, name in read_images(images_path):
        where = f"{images_path}: image {image}"
        if camera not in lenses:
            raise input_error(where, f"camera {camera} is not in {cameras_path.name}")
        if image in cameras:
            raise input_error(where, "occurs twice")
        cameras[image] = _camera(image, pose, lenses[camera], where), name
    if not cameras:
        raise input_error(images_path, "holds no images")
    return [cameras[image] for image in sorted(cameras)]


def _camera(image: int, pose: tuple[float, ...], lens: Camera, where: str) -> Camera:
    """The camera of an image from its pose (qw, qx, qy, qz, tx, ty, tz), world to camera."""
    quaternion = np.array(pose[:4])
    with np.errstate(over="ignore", invalid="ignore"):
        norm = np.linalg.norm(quaternion)
        if not (np.isfinite(norm) and norm > 0):
            raise input_error(where, f"quaternion {pose[:4]} has no direction")
        rotation = rotation_matrix(quaternion[None] / norm)[0]
    try:
        return replace(lens, rotation=rotation, translation=pose[4:], name=str(image))
    except InputError as error:
        raise input_error(where, error) from error


def _lens(model: str, size: tuple[int, int], numbers: list[float], where: str) -> Camera:
    """A camera with these intrinsics, without a pose; raises InputError unless it is a pinhole."""
    names = LENSES.get(model, "").split()
    if not names:
        raise input_error(where, f"model {model} is not supported; only pinholes are")
    if len(numbers) != len(names):
        raise input_error(where, f"{model} has {len(numbers)} parameters, not {len(names)}")
    values = dict(zip(names, numbers, strict=True))
    for name, value in values.items():
        if name not in UNDISTORTED and value != 0:
            advice = "undistort the images, as COLMAP's image_undistorter does"
            raise input_error(where, f"{model} has {name} = {value:g}, not 0; {advice}")
    focal = [values.get("f", values.get(name)) for name in ("fx", "fy")]
    try:
        return Camera(*size, *focal, values["cx"], values["cy"], np.eye(3), np.zeros(3))
    except InputError as error:
        raise input_error(where, str(error).removeprefix("camera : ")) from error


def _binary_cameras(path: Path) -> Iterator[Lens]:
    """Read cameras.bin: count, then id, model, width, height, parameters of each camera."""
    data = read_bytes(path)
    with reading(path, "is cut off"):
        (count,) = struct.unpack_from("<Q", data)
        offset = 8
        for _ in range(count):
            camera, model, *size = struct.unpack_from("<IiQQ", data, offset)
            name = MODELS[model] if 0 <= model < len(MODELS) else str(model)
            layout = f"<{len(LENSES.get(name, '').split())}d"
            numbers = list(struct.unpack_from(layout, data, offset + 24))
            yield camera, name, tuple(size), numbers
            offset += 24 + struct.calcsize(layout)


def _binary_images(path: Path) -> Iterator[tuple[int, tuple[float, ...], int, str]]:
    """Read images.bin: count, then per image id, pose, camera id, name, count of points, and 24
    bytes per point."""
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
                raise input_error(path, f"image {image}: its {points} points exceed the file")
            yield image, tuple(pose), camera, name


def text_lines(path: Path) -> list[str]:
    """Lines of a text file without comments; empty lines stay, as an image may have no points."""
    text = read_bytes(path).decode("utf-8", "replace")
    return [line for line in text.split("\n") if not line.startswith("#")]


def _text_cameras(path: Path) -> Iterator[Lens]:
    """Read cameras.txt: id, model, width, height, parameters."""
    for words in filter(None, map(str.split, text_lines(path))):
        with reading(f"{path}: camera {words[0][:40]}", "line is malformed"):
            lens = int(words[0]), words[1][:40], (int(words[2]), int(words[3]))
            numbers = [float(word) for word in words[4:]]
        yield *lens, numbers


def _text_images(path: Path) -> Iterator[tuple[int, tuple[float, ...], int, str]]:
    """Read images.txt: per image a line of id, pose, camera id, name, and a line of points."""
    lines = iter(text_lines(path))
    for line in lines:
        words = line.split(maxsplit=9)
        if not words:
            continue
        where = f"{path}: image {words[0][:40]}"
        with reading(where, "line is malformed"):
            pose = tuple(float(word) for word in words[1:8])
            image = int(words[0]), pose, int(words[8]), words[9].strip()
        if not POINTS.fullmatch(next(lines, "")):
            raise input_error(where, "next line is not a list of points (x y index …, or empty)")
        yield image


def read_points(path: str | os.PathLike) -> Points:
    """Read the points of a COLMAP model in a folder or one of its `FOLDERS`.

    Raises InputError that names the file and the point.
    """
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
                raise input_error(path, f"point {number}: its {shown} images exceed the file")
            position.append((x, y, z))
            colour.append((red, green, blue))
    return np.array(position).reshape(-1, 3), np.array(colour, np.uint8).reshape(-1, 3)


def _text_points(path: Path) -> Points:
    """Read lines of id, x, y, z, r, g, b, error, images."""
    rows = []
    for number, words in enumerate(line.split() for line in text_lines(path)):
        if not words:
            continue
        with reading(f"{path}: point {number}", "line is malformed"):
            rows.append([float(word) for word in words[1:7]])
            if len(rows[-1]) != 6 or not all(0 <= value <= 255 for value in rows[-1][3:]):
                raise ValueError("does not hold x, y, z and a colour")
    table = np.array(rows).reshape(-1, 6)
    return table[:, :3], table[:, 3:].astype(np.uint8)
