"""Written COLMAP models: byte by byte against COLMAP's documentation, and read back."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from splatcore.model.formats.colmap import read_colmap, read_points
from splatcore.model.formats.colmap_write import landing, write_colmap
from splatcore.spec.camera import Camera, look_at

TURN = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # (w, x, y, z) = (½, ½, ½, ½)
FIRST = Camera(8, 6, 10.0, 11.0, 4.0, 3.0, TURN, [0.5, 0, 1])
SECOND = Camera(8, 6, 10.0, 11.0, 4.0, 3.0, np.eye(3), [0, 0, 2])
OTHER = replace(SECOND, width=9, cx=4.5)
POINTS = np.array([[1.0, 3, 3], [0, 0, 1]]), np.array([[1, 2, 3], [255, 0, 9]], np.uint8)


def test_the_documented_layout(tmp_path):
    """The bytes follow "Binary File Format" in COLMAP's "Output Format", little-endian."""
    images = [(FIRST, "a.png"), (OTHER, "b/c.png"), (SECOND, "d.png")]
    write_colmap(tmp_path, images, POINTS, [np.array([0, 1]), np.array([1]), np.array([], int)])
    cameras = struct.pack("<Q", 2)
    cameras += struct.pack("<IiQQ4d", 1, 1, 8, 6, 10, 11, 4, 3)
    cameras += struct.pack("<IiQQ4d", 2, 1, 9, 6, 10, 11, 4.5, 3)
    assert (tmp_path / "cameras.bin").read_bytes() == cameras
    written = struct.pack("<Q", 3)
    written += struct.pack("<I7dI", 1, 0.5, 0.5, 0.5, 0.5, 0.5, 0, 1, 1) + b"a.png\0"
    written += struct.pack("<QddQddQ", 2, 12.75, 5.75, 1, 19.0, 3.0, 2)
    written += struct.pack("<I7dI", 2, 1, 0, 0, 0, 0, 0, 2, 2) + b"b/c.png\0"
    written += struct.pack("<QddQ", 1, 4.5, 3, 2)
    written += struct.pack("<I7dI", 3, 1, 0, 0, 0, 0, 0, 2, 1) + b"d.png\0" + struct.pack("<Q", 0)
    assert (tmp_path / "images.bin").read_bytes() == written
    points = struct.pack("<Q", 2)
    points += struct.pack("<Q3d3BdQ", 1, 1, 3, 3, 1, 2, 3, 0, 1) + struct.pack("<2I", 1, 0)
    points += struct.pack("<Q3d3BdQ", 2, 0, 0, 1, 255, 0, 9, 0, 2) + struct.pack("<4I", 1, 1, 2, 0)
    assert (tmp_path / "points3D.bin").read_bytes() == points


def test_our_reader(tmp_path):
    """Reading back gives equal intrinsics and translations, and rotations within 1e-15."""
    rng = np.random.default_rng(0)
    turns = Rotation.random(50, rng=rng).as_matrix()
    cameras = [
        Camera(*rng.integers(1, 9, 2), *rng.uniform(1, 9, 4), turn, rng.normal(size=3))
        for turn in turns
    ]
    write_colmap(tmp_path, [(camera, f"{k}.png") for k, camera in enumerate(cameras)], POINTS)
    for (found, name), (number, camera) in zip(
        read_colmap(tmp_path), enumerate(cameras), strict=True
    ):
        assert name == f"{number}.png"
        for field in ("width", "height", "fx", "fy", "cx", "cy"):
            assert getattr(found, field) == getattr(camera, field)
        assert np.array_equal(found.translation, camera.translation)
        assert np.abs(found.rotation - camera.rotation).max() < 1e-15
    for found, wanted in zip(read_points(tmp_path), POINTS, strict=True):
        assert np.array_equal(found, wanted) and found.dtype == wanted.dtype


def test_a_matrix_that_is_nearly_a_rotation(tmp_path):
    """Observations match the rotation in the file, not the inexact matrix that was given."""
    rough = replace(FIRST, rotation=np.array([[1, 1e-4, 0], [0, 1, 0], [0, 0, 1.0001]]))
    write_colmap(tmp_path, [(rough, "a")], POINTS, [np.array([0, 1])])
    ((camera, _),) = read_colmap(tmp_path)
    assert np.abs(camera.rotation @ camera.rotation.T - np.eye(3)).max() < 1e-15
    data = (tmp_path / "images.bin").read_bytes()[-48:]
    found = [struct.unpack_from("<dd", data, start) for start in (0, 24)]
    assert np.abs(found - landing(camera, POINTS[0])).max() < 1e-12
    assert np.abs(found - landing(rough, POINTS[0])).max() > 1e-4


def test_where_points_land():
    """The centre of the picture, and the centre of its first pixel, which COLMAP calls (½, ½)."""
    camera = look_at(np.array([1.0, -2, -5]), np.array([1.0, -2, 0]), 8, 6, 10.0)
    place = landing(camera, np.array([[1.0, -2, 0], [1 - 3.5 * 0.5, -2 - 2.5 * 0.5, 0]]))
    assert place == pytest.approx(np.array([[4, 3], [0.5, 0.5]]))
