"""Camera files (cameras.json, transforms.json, COLMAP): reading, choice of a camera, bad files."""

import json
import struct

import numpy as np
import pytest

from splatcore.model.formats.camera_file import cameras_json, read_camera, read_cameras
from splatcore.spec.camera import Camera
from tb.helpers.camera_file import EXPECTED, colmap_binary, colmap_text, inria, transforms, wxyz
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_refused, edited
from tb.helpers.scenes import needs_scenes, scene_path


def check_equal(camera: Camera, expected: Camera, name: str) -> None:
    """Compare intrinsics exactly and the pose within rounding."""
    for field in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(camera, field) == getattr(expected, field), field
    assert np.abs(camera.rotation - expected.rotation).max() < 1e-12
    assert np.abs(camera.translation - expected.translation).max() < 1e-12
    assert camera.name == name


def write(folder, files: object, name: str = "cameras.json") -> str:
    """Write a JSON value, or files given as a dict name → bytes; return the path to read."""
    if isinstance(files, dict) and all(isinstance(data, bytes) for data in files.values()):
        folder.mkdir(parents=True, exist_ok=True)
        for file, data in files.items():
            (folder / file).write_bytes(data)
        return str(folder)
    (folder / name).write_text(files if isinstance(files, str) else json.dumps(files))
    return str(folder / name)


def test_inria(tmp_path):
    cameras = read_cameras(write(tmp_path, inria()))
    for camera, expected in zip(cameras, EXPECTED, strict=True):
        check_equal(camera, expected, expected.name)


def test_inria_principal_point_and_names(tmp_path):
    entries = inria()
    entries[0] |= {"cx": 300.5, "cy": 250.25, "id": "left"}
    del entries[1]["id"], entries[1]["img_name"]
    first, second = read_cameras(write(tmp_path, entries))
    assert (first.cx, first.cy, first.name, second.name) == (300.5, 250.25, "left", "1")


def test_transforms(tmp_path):
    cameras = read_cameras(write(tmp_path, transforms()))
    for index, expected in enumerate(EXPECTED):
        check_equal(cameras[index], expected, str(index))


def test_transforms_fields_of_view(tmp_path):
    """instant-ngp's form: angles instead of focal lengths, matrices of three rows, no cx and cy."""
    value = transforms()
    for key in ("cx", "cy", "camera_model"):
        del value[key]
    value |= {"camera_angle_x": 2 * np.arctan(0.5), "aabb_scale": 16}
    for frame in value["frames"]:
        del frame["fl_x"], frame["file_path"]
        frame["transform_matrix"] = frame["transform_matrix"][:3]
    camera = read_cameras(write(tmp_path, value))[0]
    assert np.allclose([camera.fx, camera.fy, camera.cx, camera.cy], [640, 640, 320, 240])
    value["camera_angle_y"] = 2 * np.arctan(1)
    camera = read_cameras(write(tmp_path, value))[0]
    assert np.allclose([camera.fx, camera.fy], [640, 240])


COLMAP = [colmap_text(), colmap_text("SIMPLE_PINHOLE"), colmap_binary(), colmap_binary(0)]
COLMAP += [colmap_text("OPENCV") | colmap_binary()]  # if both exist, binary is read


@pytest.mark.parametrize("parent", ["", "0", "sparse/0"])
@pytest.mark.parametrize("files", COLMAP)
def test_colmap(tmp_path, files, parent):
    write(tmp_path / parent, files)
    cameras = read_cameras(tmp_path)
    for camera, expected in zip(cameras, EXPECTED, strict=True):
        check_equal(camera, expected, expected.name)


def test_one_camera(tmp_path):
    """The first by default, else by ID, image name, file name or stem; colons in paths and IDs."""
    path = write(tmp_path, inria())
    assert read_camera(path).name == "4"
    for camera_id in ("7", "view 7.png", "view 7"):
        assert read_camera(f"{path}:{camera_id}").name == "7"
    write(tmp_path, inria(), "a:7")
    assert read_camera(f"{tmp_path}/a:7").name == "4"
    assert read_camera(f"{tmp_path}/a:7:7").name == "7"
    entries = inria()
    entries[1]["id"] = "x:y"
    assert read_camera(f"{write(tmp_path, entries)}:x:y").name == "x:y"
    path = write(tmp_path, transforms(), "transforms.json")
    for camera_id in ("1", "images/view 7.png", "view 7.png", "view 7"):
        assert read_camera(f"{path}:{camera_id}").name == "1"
    folder = write(tmp_path / "sparse", colmap_binary())
    assert read_camera(f"{folder}:view 7").name == "7"


def test_unknown_camera(tmp_path):
    path = write(tmp_path, [entry | {"id": i} for i in range(9) for entry in inria()[:1]])
    refused(r"no camera '9' among its 9: 0, 1, 2, 3, 4, …", read_camera, f"{path}:9")
    for text in ("none.json", "none.json:1", "", ":", "a\0b"):
        refused("no such file", read_camera, text)


def _bytes(files: dict[str, bytes], name: str, old: bytes, new: bytes) -> dict[str, bytes]:
    """COLMAP files with one byte string in one of them replaced."""
    assert old in files[name]
    return files | {name: files[name].replace(old, new, 1)}


TEXT, BINARY = colmap_text(), colmap_binary()
FAR = 1.7e308 * np.sign(EXPECTED[1].rotation[2])
MATRIX = ("frames", 1, "transform_matrix")

BAD = {
    "is not valid JSON": "[",
    "Infinity is not JSON": '[{"fx": Infinity}]',
    "is 3, not an object": "3",
    "holds no cameras": [],
    "camera 1: is [], not an object": edited(inria(), 1, []),
    "camera 1: 'fx' is missing": edited(inria(), 1, "fx", None),
    "camera 0: 'fy': is '500', not a number": edited(inria(), 0, "fy", "500"),
    "camera 0: 'fy': is True, not a number": edited(inria(), 0, "fy", True),
    "camera 7: fx -1.0 is not > 0": edited(inria(), 1, "fx", -1),
    "camera 0: 'cx': is [], not a number": edited(inria(), 0, "cx", []),
    "camera 0: 'width': is 640.5, not an integer": edited(inria(), 0, "width", 640.5),
    "width 0 is not in": edited(inria(), 0, "width", 0),
    "height 4294967296 is not in": edited(inria(), 0, "height", 2**32),
    "camera 0: 'id': is False": edited(inria(), 0, "id", False),
    "camera 0: 'img_name': is 3": edited(inria(), 0, "img_name", 3),
    "camera 1: 'position': has 2 entries, not 3": edited(inria(), 1, "position", [1, 2]),
    "camera 1: 'position': is 1, not a list": edited(inria(), 1, "position", 1),
    "camera 1: 'rotation': is 0, not a list": edited(inria(), 1, "rotation", [0, 0, 0]),
    "camera 1: 'fx': is inf": json.dumps(inria()).replace('"fx": 510.0', '"fx": 1e999'),
    "camera 1: rotation is not a rotation": edited(inria(), 1, "rotation", 0, [2, 0, 0]),
    "camera 0: rotation is not a rotation": edited(inria(), 0, "rotation", (-np.eye(3)).tolist()),
    "translation is not a finite": edited(inria(), 1, "position", FAR.tolist()),
    "'frames' is missing": {"w": 1},
    "'frames': is {}, not a list": {"frames": {}},
    "frame 0: is 1, not an object": {"frames": [1]},
    "frame 0: 'w' is missing": edited(transforms(), "w", None),
    "frame 1: 'fl_x' is missing": edited(transforms(), "frames", 1, "fl_x", None),
    "frame 0: 'camera_angle_y' 3.2": edited(transforms(), "camera_angle_y", 3.2),
    "frame 1: 'transform_matrix' is missing": edited(transforms(), *MATRIX, None),
    "frame 1: 'transform_matrix': has 2": edited(transforms(), *MATRIX, [[0] * 4] * 2),
    "does not end with the row": edited(transforms(), *MATRIX, 3, [0, 0, 0, 2]),
    "frame 1: rotation is not a rotation": edited(transforms(), *MATRIX, [[0] * 4] * 3),
    "frame 1: 'file_path': is []": edited(transforms(), "frames", 1, "file_path", []),
    "'k1' is not 0; undistort": edited(transforms(), "k1", 0.1),
    "frame 1: 'p2' is not 0": edited(transforms(), "frames", 1, "p2", -0.1),
    "'camera_model' OPENCV_FISHEYE": edited(transforms(), "camera_model", "OPENCV_FISHEYE"),
    "'is_fisheye' is set": edited(transforms(), "is_fisheye", True),
    "no cameras.bin or cameras.txt": {"images.txt": TEXT["images.txt"]},
    "images.txt: No such file": {"cameras.txt": TEXT["cameras.txt"]},
    "cameras.txt: is empty": TEXT | {"cameras.txt": b""},
    "images.txt: holds no images": TEXT | {"images.txt": b"# none\n"},
    "camera 7: model OTHER is not": _bytes(TEXT, "cameras.txt", b"PINHOLE", b"OTHER"),
    "camera 7: PINHOLE has 3 parameters, not 4": _bytes(TEXT, "cameras.txt", b" 240", b""),
    "camera 7: line is malformed": _bytes(TEXT, "cameras.txt", b" 640 480", b" 640 x"),
    "image 7: line is malformed": _bytes(TEXT, "images.txt", b" view 7.png", b""),
    "image 7: camera 7 is not in": _bytes(TEXT, "cameras.txt", b"7 PIN", b"8 PIN"),
    "image 7: occurs twice": _bytes(TEXT, "images.txt", b"\n4 ", b"\n7 "),
    "cameras.bin: is cut off": BINARY | {"cameras.bin": BINARY["cameras.bin"][:-1]},
    "cameras.bin: is cut off ": BINARY | {"cameras.bin": b"\0" * 7},
    "images.bin: is cut off": BINARY | {"images.bin": BINARY["images.bin"][:-1]},
    "images.bin: is cut off ": BINARY | {"images.bin": b"\xff" * 8 + bytes(64)},
    "images.bin: holds no images": BINARY | {"images.bin": bytes(8)},
    "model OPENCV_FISHEYE is not": colmap_binary(5),
    "model 77 is not": colmap_binary(77),
    "model -1 is not": colmap_binary(-1),
    "image 7: its 4503599627370499 points": _bytes(
        BINARY, "images.bin", b".png\0\3\0\0\0\0\0\0\0", b".png\0\3\0\0\0\0\0\x10\0"
    ),
    "has no direction": _bytes(
        BINARY, "images.bin", struct.pack("<4d", *wxyz(EXPECTED[1])), bytes(32)
    ),
    "fx nan is not > 0": _bytes(
        BINARY, "cameras.bin", struct.pack("<d", 510), struct.pack("<d", np.nan)
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_file(tmp_path, message):
    path = write(tmp_path, BAD[message])
    check_refused(read_cameras, path, message)


@needs_scenes
def test_real_files():
    """Over half of COLMAP's points project into each photograph; every scene's file is read."""
    cameras = read_cameras(scene_path("banana/sparse/0"))
    assert len(cameras) == 14 and {(c.width, c.height) for c in cameras} == {(1000, 665)}
    assert [c.name for c in read_cameras(scene_path("banana"))] == [c.name for c in cameras]
    data = scene_path("banana/sparse/0/points3D.bin").read_bytes()
    points, offset = [], 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        points.append(struct.unpack_from("<3d", data, offset + 8))
        offset += 51 + 8 * struct.unpack_from("<Q", data, offset + 43)[0]
    for camera in cameras:
        p = np.array(points) @ camera.rotation.T + camera.translation
        uv = p[:, :2] / p[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        inside = (p[:, 2] > 0) & (uv > 0).all(axis=1) & (uv < [1000, 665]).all(axis=1)
        assert inside.mean() > 0.5
    for path in scene_path("").glob("*.cameras.json"):
        assert all((c.width, c.height) == (1920, 1080) for c in read_cameras(path))
    assert read_camera(f"{scene_path('kitchen.cameras.json')}:kitchen_01").name == "1"


def test_written_cameras_come_back(tmp_path):
    cameras = read_cameras(write(tmp_path, inria()))
    (tmp_path / "again.json").write_text(cameras_json(cameras))
    again = read_cameras(tmp_path / "again.json")
    assert len(again) == len(cameras)
    for camera, expected in zip(again, cameras, strict=True):
        check_equal(camera, expected, expected.name)
