"""Camera files: cameras.json of the original 3DGS, transforms.json of NeRF tools, COLMAP folders.

Each becomes `Camera`s, with OpenCV axes and the transform from world to camera.
"""

import json
import math
import os

import numpy as np

from splatcore.model.formats import file
from splatcore.model.formats.colmap import read_colmap
from splatcore.model.formats.file import input_error
from splatcore.spec.camera import Camera
from splatcore.spec.error import InputError

ORTHONORMAL_TOLERANCE = 1e-2
"""Largest entry of R·Rᵀ − 1 at which a matrix of a file still counts as a rotation."""

DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
"""Coefficients of lens distortion in transforms.json; all must be 0."""

PINHOLE_MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL")
"""Values of "camera_model" that are pinholes if the distortion is 0."""

CAMERAS = "cameras.json"

Named = list[tuple[Camera, str]]
"""Cameras, each with the file name of its image ("" if the file has none)."""


def read_cameras(path: str | os.PathLike, ids: list[str] | None = None) -> list[Camera]:
    """All cameras of a cameras.json (or the folder around it), a transforms.json or a COLMAP folder
    (or its parent), or those that IDs mean."""
    named = read_named(path)
    return [camera for camera, _ in named] if ids is None else [_find(named, i, path) for i in ids]


def read_camera(text: str) -> Camera:
    """The camera that "FILE" (its first) or "FILE:ID" means.

    ID is a camera's name or its image's, with or without folder and extension.
    """
    path, camera_id = split_id(text)
    if not os.path.exists(path):
        raise input_error(text, "no such file")
    named = read_named(path)
    return named[0][0] if camera_id is None else _find(named, camera_id, path)


def _find(named: Named, camera_id: str, path: str | os.PathLike) -> Camera:
    """The camera that an ID means; InputError if there is none."""
    for camera, _ in named:
        if camera.name == camera_id:
            return camera
    for camera, image in named:
        base = os.path.basename(image)
        if camera_id in (image, base, os.path.splitext(base)[0]):
            return camera
    some = ", ".join(camera.name for camera, _ in named[:5]) + (", …" if len(named) > 5 else "")
    raise input_error(path, f"no camera {camera_id!r}; there are {len(named)}: {some}")


def split_id(text: str) -> tuple[str, str | None]:
    """FILE and ID of "FILE:ID"; no ID of "FILE". A colon may also be part of FILE: the longest FILE
    that exists is taken."""
    path, camera_id = text, None
    while not os.path.exists(path) and ":" in path:
        path = path.rpartition(":")[0]
        camera_id = text[len(path) + 1 :]
    return path, camera_id


def read_named(path: str | os.PathLike) -> Named:
    """Cameras of any of the formats, each with its image's file name as the file has it."""
    if os.path.isdir(path):
        if not os.path.isdir(os.path.join(path, "point_cloud")):
            return read_colmap(path)
        path = os.path.join(path, CAMERAS)  # of a folder as INRIA's training leaves it
    value = file.parse_json(file.read_bytes(path), path)
    named = _inria(value, path) if isinstance(value, list) else _transforms(value, path)
    if not named:
        raise input_error(path, "holds no cameras")
    return named


def _camera(intrinsics: tuple, pose: np.ndarray, name: str, where: str) -> Camera:
    """A camera from (width, height, fx, fy, cx, cy) and the pose [3, 4], camera to world."""
    rotation, position = pose[:, :3], pose[:, 3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if not (error <= ORTHONORMAL_TOLERANCE and np.linalg.det(rotation) > 0):
            raise input_error(where, "rotation is no rotation matrix")
        translation = -rotation.T @ position
    try:
        return Camera(*intrinsics, rotation.T, translation, name)
    except InputError as error:
        prefix = f"camera {name}: "  # once is enough
        known = f"{where}: ".endswith(f" {prefix}")
        raise input_error(where, str(error).removeprefix(prefix if known else "")) from error


def _inria(value: list, path: str | os.PathLike) -> Named:
    """cameras.json as the original 3DGS writes it (`camera_to_JSON`): `position` is the camera's
    centre, `rotation` camera to world, both with OpenCV axes; cx and cy are an addition.
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


def _transforms(value: object, path: str | os.PathLike) -> Named:
    """transforms.json of instant-ngp and nerfstudio: `transform_matrix` is camera to world with
    OpenGL axes (y up, z back); intrinsics in pixels stand in the file or in each frame.
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
        camera = _camera(_frame_intrinsics(frame, where), pose, str(index), where)
        named.append((camera, file.field(frame, "file_path", str, where, "")))
    return named


def _check_undistorted(frame: dict, where: str) -> None:
    """Refuses a lens that is not a pinhole."""
    model = file.field(frame, "camera_model", str, where, "")
    if model not in ("", *PINHOLE_MODELS):
        raise input_error(where, f"'camera_model' {model} is not supported")
    if frame.get("is_fisheye", False) is not False:
        raise input_error(where, "'is_fisheye' is set, fisheye lenses are not supported")
    for name in DISTORTION:
        if file.field(frame, name, float, where, 0.0) != 0:
            raise input_error(where, f"{name!r} is not 0, lens distortion is not supported")


def _frame_intrinsics(frame: dict, where: str) -> tuple:
    """(width, height, fx, fy, cx, cy); a focal length may be given by a field of view instead."""
    width, height = (file.field(frame, side, int, where) for side in ("w", "h"))

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
    """The text of a cameras.json with these cameras; `read_cameras` reads it back."""
    entries = []
    for camera in cameras:
        entry = {"id": camera.name, "img_name": camera.name}
        entry |= {"width": camera.width, "height": camera.height}
        entry |= {"position": camera.position.tolist(), "rotation": camera.rotation.T.tolist()}
        entries.append(entry | {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")})
    return json.dumps(entries, indent=1)
