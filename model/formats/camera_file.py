"""Camera files: cameras.json of the original 3DGS, transforms.json of NeRF tools, COLMAP folders.

All are converted to `Camera`: OpenCV axes, transform from world to camera.
"""

import json
import math
import os
import re
from pathlib import Path

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.colmap import (
    LENSES,
    cameras_file,
    colmap_folder,
    find_colmap,
    read_colmap,
)
from splatcore.model.formats.file import input_error
from splatcore.model.formats.photograph_file import photograph_file, photograph_size
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError

ORTHONORMAL_TOLERANCE = 1e-2
"""Largest entry of R·Rᵀ − 1 with which a matrix R of a file is accepted as a rotation."""

DISTORTION = re.compile(
    r"(k|p|b|s|sx|sy|ftheta_p)\d+|k|omega|skew|(?i:\w*distortion\w*)"
    r"|latlong|equirectangular|orthographic"
)
"""Names of lens distortion in transforms.json, as written by nerfstudio, instant-NGP, COLMAP and
OpenCV; all their values must be 0."""

CAMERAS, TRANSFORMS = "cameras.json", ("transforms.json", "transforms_train.json")

Named = list[tuple[Camera, str]]
"""Cameras, each with the file name of its image ("" if the file names none)."""


Size = tuple[int, int]  # width, height in pixels


def read_cameras(
    path: str | os.PathLike, ids: list[str] | None = None, size: Size | None = None
) -> list[Camera]:
    """Read all cameras of a file or folder, or some of them.

    path: a cameras.json (or INRIA's folder around it), a transforms.json, a COLMAP model, or a
        folder with one of these
    ids: IDs of the cameras to return (default: all)
    size: picture size of cameras that state none and name no readable photograph; other cameras
        are not resized to it
    """
    named = read_named(path, size)
    return [camera for camera, _ in named] if ids is None else [_find(named, i, path) for i in ids]


def read_camera(text: str, size: Size | None = None) -> Camera:
    """Read the camera "FILE:ID", or the first one of "FILE".

    ID: name of the camera or of its image, with or without folder and extension
    size: as for `read_cameras`
    """
    path, camera_id = split_id(text)
    if not os.path.exists(path):
        hint = f"; camera {text} of FILE is FILE:{text}" if re.fullmatch(r"\w+", text) else ""
        raise input_error(text, f"no such file{hint}")
    named = read_named(path, size)
    return named[0][0] if camera_id is None else _find(named, camera_id, path)


def _find(named: Named, camera_id: str, path: str | os.PathLike) -> Camera:
    """The camera with an ID, or InputError."""
    for camera, _ in named:
        if camera.name == camera_id:
            return camera
    for camera, image in named:
        base = os.path.basename(image.replace("\\", "/"))
        if camera_id in (image, base, os.path.splitext(base)[0]):
            return camera
    some = ", ".join(camera.name for camera, _ in named[:5]) + (", …" if len(named) > 5 else "")
    raise input_error(path, f"no camera {camera_id!r} among its {len(named)}: {some}")


def split_id(text: str) -> tuple[str, str | None]:
    """Split "FILE:ID" into FILE and ID; the ID of "FILE" is None.

    FILE itself may contain colons: the longest FILE that exists is taken.
    """
    path, camera_id = text, None
    while not os.path.exists(path) and ":" in path:
        path = path.rpartition(":")[0]
        camera_id = text[len(path) + 1 :]
    return path, camera_id


def camera_place(path: str | os.PathLike) -> Path:
    """Find the file of cameras, or the folder of a COLMAP model, at a path.

    In a folder, the first one found of: INRIA's cameras.json next to a `point_cloud`, a COLMAP
    model, a transforms.json, any other cameras.json. COLMAP comes before transforms.json because
    its points are in the frame of its cameras.
    """
    if not os.path.isdir(path):
        return Path(path)
    files = [Path(path, name) for name in (*TRANSFORMS, CAMERAS)]
    if os.path.isdir(os.path.join(path, "point_cloud")):
        return files[-1]
    if folder := find_colmap(path):
        return folder
    if found := next(filter(Path.is_file, files), None):
        return found
    try:
        return colmap_folder(path)
    except InputError as error:
        names = ", ".join(TRANSFORMS)
        raise InputError(f"{error}; no {names} or {CAMERAS} in it") from None


def size_file(path: str | os.PathLike) -> Path:
    """The file that states the picture sizes of the cameras at a path."""
    place = camera_place(path)
    return cameras_file(place) if place.is_dir() else place


def read_named(path: str | os.PathLike, size: Size | None = None) -> Named:
    """Read cameras of any format, each with its image's file name as written in the file."""
    place = camera_place(path)
    if place.is_dir():
        return read_colmap(place)
    value = file.parse_json(file.read_bytes(place), place)
    named = _inria(value, place) if isinstance(value, list) else _transforms(value, place, size)
    if not named:
        raise input_error(place, "holds no cameras")
    return named


def _camera(intrinsics: tuple, pose: np.ndarray, name: str, where: str) -> Camera:
    """A camera from (width, height, fx, fy, cx, cy) and the pose [3, 4], camera to world."""
    rotation, position = pose[:, :3], pose[:, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not (error <= ORTHONORMAL_TOLERANCE and np.linalg.det(rotation) > 0):
            raise input_error(where, "rotation is not a rotation matrix")
        translation = -rotation.T @ position
    try:
        return Camera(*intrinsics, rotation.T, translation, name)
    except InputError as error:
        prefix = f"camera {name}: "  # not twice in a message
        known = f"{where}: ".endswith(f" {prefix}")
        raise input_error(where, str(error).removeprefix(prefix if known else "")) from error


def _inria(value: list, path: Path) -> Named:
    """Read a cameras.json of the original 3DGS (`camera_to_JSON`).

    `position` is the camera's centre, `rotation` is camera to world, both with OpenCV axes; cx and
    cy are our extension.
    """
    named = []
    for index, entry in enumerate(value):
        where = f"{path}: camera {index}"
        entry = file.checked(entry, dict, where)
        width, height = (file.field(entry, side, int, where) for side in ("width", "height"))
        fx, fy = (file.field(entry, name, float, where) for name in ("fx", "fy"))
        cx = file.field(entry, "cx", float, where, width / 2)
        cy = file.field(entry, "cy", float, where, height / 2)
        rotation = file.array_field(entry, "rotation", (3, 3), where)
        position = file.array_field(entry, "position", (3,), where)
        name = entry.get("id", index)
        if not isinstance(name, str):
            name = str(file.checked(name, int, f"{where}: 'id'"))
        pose = np.column_stack([rotation, position])
        image = file.field(entry, "img_name", str, where, "")
        named.append((_camera((width, height, fx, fy, cx, cy), pose, name, where), image))
    return named


def _transforms(value: object, path: Path, size: Size | None) -> Named:
    """Read a transforms.json of instant-ngp or nerfstudio.

    `transform_matrix` is camera to world with OpenGL axes (y up, z back); intrinsics, in pixels,
    are given for the file or for each frame.
    """
    table = file.checked(value, dict, path)
    named = []
    for index, entry in enumerate(file.field(table, "frames", list, path)):
        where = f"{path}: frame {index}"
        frame = table | file.checked(entry, dict, where)
        _check_undistorted(frame, where)
        matrix = file.field(frame, "transform_matrix", list, where)
        rows = 3 if len(matrix) == 3 else 4
        pose = file.array_field(frame, "transform_matrix", (rows, 4), where)
        if rows == 4 and np.abs(pose[3] - (0, 0, 0, 1)).max() > ORTHONORMAL_TOLERANCE:
            raise input_error(where, "'transform_matrix' does not end with the row 0 0 0 1")
        pose = pose[:3] * (1, -1, -1, 1)  # OpenGL axes to OpenCV axes
        sides = _frame_size(frame, path.parent, size, where)
        camera = _camera(_frame_intrinsics(frame, *sides, where), pose, str(index), where)
        named.append((camera, file.field(frame, "file_path", str, where, "")))
    return named


def _check_undistorted(frame: dict, where: str) -> None:
    """Raise InputError for a lens that is not a pinhole."""

    def zero(value: object) -> bool:
        if isinstance(value, dict | list):
            return all(map(zero, value.values() if isinstance(value, dict) else value))
        return value is None or (isinstance(value, int | float) and value == 0)

    model = file.field(frame, "camera_model", str, where, "")
    if model and not LENSES.get(model):
        raise input_error(where, f"'camera_model' {model} is not supported")
    if not zero(frame.get("is_fisheye")):
        raise input_error(where, "'is_fisheye' is set; fisheye lenses are not supported")
    for name, value in frame.items():
        if DISTORTION.fullmatch(name) and not zero(value):
            raise input_error(where, f"{name!r} is not 0; undistort the photographs first")


def _frame_size(frame: dict, folder: Path, size: Size | None, where: str) -> Size:
    """Width and height of a frame's picture: from the frame, else from its photograph, else `size`
    if no value of the frame is in pixels."""
    if "w" in frame or "h" in frame:
        width, height = (file.field(frame, side, int, where) for side in ("w", "h"))
        return width, height
    image = file.field(frame, "file_path", str, where, "")
    if image and (found := photograph_size(photograph_file(folder, image))):
        return found
    if size is None:
        why = "and the photograph cannot be read; give the size by --size"
        raise input_error(where, f"'w' is missing, {why}")
    for name in ("fl_x", "fl_y", "cx", "cy"):
        if name in frame:
            raise input_error(where, f"'w' is missing, but {name!r} is in pixels; add 'w' and 'h'")
    return size


def _frame_intrinsics(frame: dict, width: int, height: int, where: str) -> tuple:
    """(width, height, fx, fy, cx, cy); fields of view may replace focal lengths."""

    def focal(name: str, angle_name: str, side: int) -> float | None:
        if name in frame:
            return file.field(frame, name, float, where)
        if angle_name not in frame:
            return None
        angle = file.field(frame, angle_name, float, where)
        if not 0 < angle < math.pi:
            raise input_error(where, f"{angle_name!r} {angle} is not between 0 and π")
        return side / (2 * math.tan(angle / 2))

    fx = focal("fl_x", "camera_angle_x", width)
    if fx is None:
        raise input_error(where, "'fl_x' is missing")
    fy = focal("fl_y", "camera_angle_y", height) or fx  # square pixels unless stated
    cx = file.field(frame, "cx", float, where, width / 2)
    cy = file.field(frame, "cy", float, where, height / 2)
    return width, height, fx, fy, cx, cy


def cameras_json(cameras: list[Camera]) -> str:
    """The text of a cameras.json that `read_cameras` reads."""
    entries = []
    for camera in cameras:
        entry = {"id": camera.name, "img_name": camera.name}
        entry |= {"width": camera.width, "height": camera.height}
        entry |= {"position": camera.position.tolist(), "rotation": camera.rotation.T.tolist()}
        entries.append(entry | {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")})
    return json.dumps(entries, indent=1)
