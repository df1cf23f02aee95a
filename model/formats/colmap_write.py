"""A COLMAP model in binary: `cameras.bin`, `images.bin`, `points3D.bin`.

Source: COLMAP documentation, "Output Format"; `colmap` reads the same layouts.
"""

import struct
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from splatcore.model.formats.colmap import MODELS, POINT, Points
from splatcore.spec.camera import Camera
from splatcore.spec.scene import rotation_matrix

MODEL = "PINHOLE"

NOWHERE: Points = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
"""No points."""

ERROR = 0.0
"""Reprojection error of every point, pixels: points in images are exact projections."""


def write_colmap(
    folder: Path,
    images: Sequence[tuple[Camera, str]],
    points: Points = NOWHERE,
    shown: Sequence[np.ndarray] | None = None,
):
    """Write a COLMAP model.

    images: cameras with the file names of their images
    shown: for each image, the indices of the points in it, all in front of its camera (default:
        images have no points)

    Images, points and distinct intrinsics are numbered from 1, in order.
    """
    shown = [np.zeros(0, int)] * len(images) if shown is None else shown
    intrinsics = {}
    for camera, _ in images:
        intrinsics.setdefault(_intrinsics(camera), len(intrinsics) + 1)
    parts = {
        "cameras.bin": [
            struct.pack("<IiQQ4d", number, MODELS.index(MODEL), *found)
            for found, number in intrinsics.items()
        ],
        "images.bin": [
            _image(number, camera, intrinsics[_intrinsics(camera)], name, points[0], seen)
            for number, ((camera, name), seen) in enumerate(zip(images, shown, strict=True), 1)
        ],
        "points3D.bin": _points(points, shown),
    }
    for name, records in parts.items():
        (folder / name).write_bytes(struct.pack("<Q", len(records)) + b"".join(records))


def landing(camera: Camera, position: np.ndarray) -> np.ndarray:
    """Project points [N, 3] to COLMAP's pixel coordinates [N, 2], whose centres are at half
    integers. The result is arbitrary for points that are not in front of the camera."""
    point = position @ camera.rotation.T + camera.translation
    with np.errstate(all="ignore"):
        return point[:, :2] / point[:, 2:] * (camera.fx, camera.fy) + [camera.cx, camera.cy]


def _intrinsics(camera: Camera) -> tuple[int, int, float, float, float, float]:
    return camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy


def _image(
    number: int, camera: Camera, intrinsics: int, name: str, position: np.ndarray, seen: np.ndarray
) -> bytes:
    """An image record: id, quaternion (w, x, y, z), translation, camera id, name, and per point
    x, y, point id.

    A rotation matrix that is inexact in its last digits is stored as the nearest rotation, by which
    points are projected.
    """
    from scipy.spatial.transform import Rotation  # takes half a second

    turn = Rotation.from_matrix(camera.rotation).as_quat(scalar_first=True)
    table = np.zeros(len(seen), np.dtype([("place", "<f8", 2), ("point", "<u8")]))
    stored = replace(camera, rotation=rotation_matrix(turn[None])[0])
    table["place"] = landing(stored, position[seen])
    table["point"] = seen + 1
    start = struct.pack("<I7dI", number, *turn, *camera.translation, intrinsics)
    return start + name.encode() + b"\0" + struct.pack("<Q", len(seen)) + table.tobytes()


def _points(points: Points, shown: Sequence[np.ndarray]) -> list[bytes]:
    """Point records: id, x, y, z, r, g, b, error, and the track: id of each image that shows the
    point, and the point's place in that image's list."""
    tracks = [[] for _ in points[0]]
    for number, seen in enumerate(shown, 1):
        for place, point in enumerate(seen):
            tracks[point].append((number, place))
    return [
        POINT.pack(number, *map(float, position), *map(int, colour), ERROR, len(track))
        + np.array(track, "<u4").tobytes()
        for number, (position, colour, track) in enumerate(zip(*points, tracks, strict=True), 1)
    ]
