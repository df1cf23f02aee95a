"""Captures as tools write them: folder layouts, point lines, sizes and names of photographs.

Lenses: pinholes under any name are read, distortion under any name is refused.
"""

import json
import struct

import numpy as np
import pytest
from PIL import Image

from splatcore.model.formats.camera_file import read_camera, read_cameras, size_file
from splatcore.model.formats.colmap import read_points
from splatcore.model.formats.photographs import read_photographs
from tb.helpers.camera_file import (
    EXPECTED,
    colmap,
    colmap_binary,
    colmap_text,
    lens,
    photographs,
    transforms,
    transforms_file,
)
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_refused, edited

COUNT = len(EXPECTED)
PINHOLE = [510.0, 500.0, 320.0, 240.0]  # fx, fy, cx, cy of lenses below

FOLDERS = ["", "0", "sparse", "sparse/0", "colmap", "colmap/sparse", "colmap/sparse/0"]
"""Folders with a COLMAP model: image_undistorter writes `sparse`, nerfstudio `colmap/sparse/0`."""


@pytest.mark.parametrize("place", FOLDERS)
def test_folders(tmp_path, place):
    """Cameras, points and photographs are found wherever the capture keeps its COLMAP model."""
    colmap(tmp_path / "capture" / place, colmap_binary())
    photographs(tmp_path / "capture")
    assert len(read_cameras(tmp_path / "capture")) == COUNT
    assert read_points(tmp_path / "capture")[0].tolist() == [[0.5, 0, 0]]
    assert len(read_photographs(tmp_path / "capture").targets) == COUNT
    assert len(read_photographs(tmp_path / "capture" / place).targets) == COUNT


@pytest.mark.parametrize("name", ["transforms.json", "transforms_train.json"])
def test_a_folder_with_transforms(tmp_path, name):
    photographs(tmp_path)
    path = transforms_file(tmp_path, transforms(), name)
    assert len(read_cameras(tmp_path)) == COUNT == len(read_photographs(tmp_path).targets)
    assert read_camera(f"{tmp_path}:view 7").name == "1"
    assert size_file(tmp_path) == path


def test_a_folder_with_both(tmp_path):
    """COLMAP's cameras are read: they match COLMAP's points, while nerfstudio rotates its own."""
    colmap(tmp_path / "colmap" / "sparse" / "0", colmap_binary())
    transforms_file(tmp_path, transforms())
    photographs(tmp_path)
    assert [camera.name for camera in read_cameras(tmp_path)] == ["4", "7"]
    assert read_photographs(tmp_path).targets[0].camera.fy == EXPECTED[0].fy / 10
    assert [camera.name for camera in read_cameras(tmp_path / "transforms.json")] == ["0", "1"]


def test_a_folder_without_cameras(tmp_path):
    for read in (read_cameras, read_photographs):
        check_refused(
            read, tmp_path, "no cameras.bin or cameras.txt in it or in its folders 0, sparse/0"
        )
        check_refused(read, tmp_path, "no transforms.json, transforms_train.json or cameras.json")


WRONG = {
    "missing": lambda text: "".join(f"{x}\n" for x in text.splitlines() if "view" in x),
    "not triples": lambda text: text.replace("1.5 2.5 -1 3.5 4.5 9", "1.5 2.5 -1 3.5 4.5"),
    "no numbers": lambda text: text.replace("1.5 2.5 -1", "1.5 x -1"),
    "no index": lambda text: text.replace("1.5 2.5 -1", "1.5 2.5 0.5"),
}


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_lines_of_points(tmp_path, wrong, end):
    """The second line of each image in images.txt must be a point list; it is not just skipped."""
    files = colmap_text()
    text = WRONG[wrong](files["images.txt"].decode()).replace("\n", end)
    colmap(tmp_path / "sparse", files | {"images.txt": text.encode()})
    where = f"{tmp_path}/sparse/images.txt: image 7: next line is not a list of points"
    check_refused(read_cameras, tmp_path, where)


def test_lines_without_points(tmp_path):
    """A point list may be empty, missing at the end of the file, or contain NaN."""
    files = colmap_text()
    text = files["images.txt"].decode().replace("1.5 2.5 -1 3.5 4.5 9", " 1e-3 nan -1 \t")
    colmap(tmp_path, files | {"images.txt": text.rstrip().encode()})
    assert len(read_cameras(tmp_path)) == COUNT


def blender() -> dict:
    """A transforms.json without sizes, as Blender's exporters write it."""
    table = {key: None for key in ("w", "h", "cx", "cy")}
    table = {key: value for key, value in transforms().items() if key not in table}
    for frame in table["frames"]:
        del frame["fl_x"]
        frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")
    return table | {"camera_angle_x": 2 * np.arctan(0.5)}


def test_size_of_the_photographs(tmp_path):
    path = transforms_file(tmp_path, blender())
    check_refused(read_cameras, path, "frame 0: 'w' is missing, and the photograph cannot be read")
    photographs(tmp_path, (80, 40))
    for size in (None, (500, 500)):  # --size resizes; the photographs' shape is the truth
        camera = read_cameras(path, size=size)[1]
        assert (camera.width, camera.height, camera.cx, camera.cy) == (80, 40, 40, 20)
        assert np.allclose([camera.fx, camera.fy], 80)
    (tmp_path / "images" / "view 4.png").write_bytes(b"broken")
    found = read_photographs(tmp_path)
    assert len(found.targets) == COUNT - 1 and len(found.missing) == 1
    assert found.targets[0].camera.width == 80 and len(found.notes) == 1


def test_size_of_the_picture(tmp_path):
    """Without photographs, --size is enough for a field of view, but not for values in pixels."""
    path = transforms_file(tmp_path, blender())
    camera = read_camera(str(path), (200, 100))
    assert (camera.width, camera.height, camera.cx) == (200, 100, 100)
    assert np.allclose([camera.fx, camera.fy], 200)
    assert read_cameras(path, ["0"], (100, 50))[0].width == 100
    for field in ("fl_x", "fl_y", "cx", "cy"):
        path = transforms_file(tmp_path, blender() | {field: 30.0})
        message = f"frame 0: 'w' is missing, but {field!r} is in pixels"
        refused(message, read_camera, str(path), (200, 100))
    path = transforms_file(tmp_path, blender() | {"w": 64})
    check_refused(lambda path: read_cameras(path, None, (9, 9)), path, "frame 0: 'h' is missing")


def test_size_in_the_photographs_pixels(tmp_path):
    photographs(tmp_path)
    path = transforms_file(tmp_path, blender() | {"fl_x": 50.0, "cy": 20.0})
    camera = read_cameras(path)[0]
    assert (camera.width, camera.fx, camera.fy, camera.cx, camera.cy) == (64, 50, 50, 32, 20)


@pytest.mark.parametrize("kind", ["transforms", "colmap"])
def test_backslashes(tmp_path, kind):
    """A backslash in a name means a slash if no file has that name."""
    photographs(tmp_path)
    names = [f"view {camera.name}.png" for camera in EXPECTED]
    if kind == "transforms":
        table = transforms()
        for frame, name in zip(table["frames"], names, strict=True):
            frame["file_path"] = f".\\images\\{name}"
        transforms_file(tmp_path, table)
    else:
        (tmp_path / "images" / "left").mkdir()
        for name in names:
            (tmp_path / "images" / name).rename(tmp_path / "images" / "left" / name)
        files = colmap_binary()
        files["images.bin"] = files["images.bin"].replace(b"view", b"left\\view")
        colmap(tmp_path / "sparse", files)
    found = read_photographs(tmp_path)
    assert len(found.targets) == COUNT and not found.missing
    assert read_camera(f"{tmp_path}:view 7").name == ("1" if kind == "transforms" else "7")


def test_a_backslash_in_a_name(tmp_path):
    photographs(tmp_path)
    Image.new("RGB", (64, 48), (9, 9, 9)).save(tmp_path / "images\\view 4.png")
    table = edited(transforms(), "frames", 0, "file_path", "images\\view 4.png")
    transforms_file(tmp_path, table)
    found = {target.name: target.image.max() for target in read_photographs(tmp_path).targets}
    assert found == {"images\\view 4.png": 9, "images/view 7.png": 0}


def test_one_photograph_by_two_names(tmp_path):
    """Different spellings of one path are one photograph."""
    photographs(tmp_path)
    table = transforms()
    frame = table["frames"][0]
    table["frames"] += [
        frame | {"file_path": name} for name in ("images\\view 4", "./images/view 4")
    ]
    transforms_file(tmp_path, table)
    names = [target.name for target in read_photographs(tmp_path).targets]
    assert names == ["images/view 4.png", "images/view 7.png"]


def test_large_cameras(tmp_path):
    """A large camera is scaled to a small photograph; an invalid size is refused with its file."""
    files = lens("PINHOLE", 7425.0, 7425.0, 4752.0, 3168.0)
    size, large = struct.pack("<QQ", 640, 480), struct.pack("<QQ", 9504, 6336)
    colmap(tmp_path / "sparse", {k: v.replace(size, large) for k, v in files.items()})
    photographs(tmp_path, (150, 100))
    target = read_photographs(tmp_path).targets[0]
    assert target.image.shape == (100, 150, 3)
    assert np.allclose([target.camera.fx, target.camera.cx], [7425 * 150 / 9504, 75])
    assert read_cameras(tmp_path)[0].width == 9504
    assert size_file(tmp_path) == tmp_path / "sparse" / "cameras.bin"
    for wrong in (0, 2**31):
        data = files["cameras.bin"].replace(size, struct.pack("<QQ", 640, wrong))
        (tmp_path / "sparse" / "cameras.bin").write_bytes(data)
        where = f"{tmp_path}/sparse/cameras.bin: camera 7: height {wrong} is not in 1 … 2147483647"
        check_refused(read_cameras, tmp_path, where)


def test_large_photographs(tmp_path, monkeypatch):
    """Photographs may exceed PIL's pixel limit, which stays unchanged."""
    colmap(tmp_path / "sparse", colmap_binary())
    photographs(tmp_path, (640, 480))
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 640 * 48)
    assert len(read_photographs(tmp_path, 0.1).targets) == COUNT
    assert Image.MAX_IMAGE_PIXELS == 640 * 48
    for file in (tmp_path / "images").iterdir():
        Image.new("L", (9000, 6750)).save(file)
    found = read_photographs(tmp_path, 0.01).targets[0]
    assert found.image.shape == (68, 90, 3) and found.camera.fx == pytest.approx(500 * 90 / 640)


def test_cameras_that_occur_twice(tmp_path):
    files = colmap_text("PINHOLE", *PINHOLE)
    files["cameras.txt"] = files["cameras.txt"].replace(b"7 P", b"4 P")
    colmap(tmp_path, files)
    check_refused(read_cameras, tmp_path, "cameras.txt: camera 4: occurs twice")


LENSES = {
    "SIMPLE_PINHOLE": 0, "PINHOLE": 0, "SIMPLE_RADIAL": 1, "RADIAL": 2, "OPENCV": 4,
    "FULL_OPENCV": 8, "FOV": 1, "SIMPLE_DIVISION": 1, "DIVISION": 1,
}  # fmt: skip
"""Models that are pinholes if all distortion is 0 → number of distortion coefficients."""

ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_DIVISION")


@pytest.mark.parametrize("files", [lens, colmap_text])
@pytest.mark.parametrize("model", LENSES)
def test_lenses_of_colmap(tmp_path, files, model):
    focal = PINHOLE[1:] if model in ONE_FOCAL else PINHOLE
    count = LENSES[model]
    colmap(tmp_path / "0", files(model, *focal, *[0.0] * count))
    camera = read_cameras(tmp_path)[0]
    assert [camera.fx, camera.fy, camera.cx, camera.cy] == [focal[0], *PINHOLE[1:]]
    for index in range(count):
        numbers = [0.0] * count
        numbers[index] = -0.25
        colmap(tmp_path / "bad", files(model, *focal, *numbers))
        refused(rf"cameras\.\w+: camera 7: {model} has \w+ = -0.25", read_cameras, tmp_path / "bad")


@pytest.mark.parametrize("beta", [1.0, 0.5])
def test_unified_camera_model(tmp_path, beta):
    """alpha is the distortion; beta has no effect if alpha is 0."""
    colmap(tmp_path / "0", lens("EUCM", *PINHOLE, 0.0, beta))
    assert read_cameras(tmp_path)[0].fx == PINHOLE[0]
    colmap(tmp_path / "1", lens("EUCM", *PINHOLE, 0.5, beta))
    check_refused(read_cameras, tmp_path / "1", "camera 7: EUCM has alpha = 0.5")


FISHEYES = {
    "OPENCV_FISHEYE": 8,
    "SIMPLE_FISHEYE": 3,
    "THIN_PRISM_FISHEYE": 12,
    "EQUIRECTANGULAR": 2,
}


@pytest.mark.parametrize("model, count", FISHEYES.items())
def test_lenses_that_are_no_pinholes(tmp_path, model, count):
    """A fisheye lens is refused even if its distortion is 0."""
    colmap(tmp_path, lens(model, *[500.0] * 2, *[0.0] * (count - 2)))
    check_refused(read_cameras, tmp_path, f"camera 7: model {model} is not supported")


DISTORTED = [
    *({name: 0.1} for name in ("k", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "b1", "s1")),
    *({name: 0.1} for name in ("sx1", "sy1", "omega", "skew", "ftheta_p0", "ftheta_p4")),
    {"distortion_params": [-0.3, 0.1, 0, 0, 0, 0]},
    {"distortion": {"radial": [0, 0.1]}},
    {"distortion_coefficients": [[0, 0, 1e-9]]},
    {"radial_distortion": "0.1"},
    {"distortionParams": [0.1]},
    {"lensDistortion": {"K1": 0.1}},
    {"latlong": True},
    {"equirectangular": True},
    {"orthographic": True},
]


@pytest.mark.parametrize("value", DISTORTED, ids=lambda value: next(iter(value)))
def test_distortion(tmp_path, value):
    """In the file or in a frame, under any name; only zeros are a pinhole."""
    (name,) = value
    path = transforms_file(tmp_path, transforms() | value)
    check_refused(read_cameras, path, f"frame 0: {name!r} is not 0")
    table = transforms()
    table["frames"][1] |= value
    check_refused(read_cameras, transforms_file(tmp_path, table), f"frame 1: {name!r} is not 0")
    zeros = json.loads(json.dumps(value).replace("0.1", "0").replace("-0.3", "0.0"))
    zeros = json.loads(json.dumps(zeros).replace("1e-09", "0").replace("true", "false"))
    if name != "radial_distortion":
        assert len(read_cameras(transforms_file(tmp_path, transforms() | zeros))) == len(EXPECTED)


def test_frame_without_distortion(tmp_path):
    """A frame's values override the file's; unrelated names are not taken for distortion."""
    table = transforms() | {"k1": 0.1, "is_undistorted": True, "keep": 1, "scale": 2, "p": "a"}
    for frame in table["frames"]:
        frame |= {"k1": 0, "camera_model": "FULL_OPENCV", "distortion": None}
    assert len(read_cameras(transforms_file(tmp_path, table))) == len(EXPECTED)
