"""Lenses of captures: pinholes under any name are read, distortion under any name is refused."""

import json

import pytest

from splatcore.model.formats.camera_file import read_cameras
from tb.helpers.camera_file import EXPECTED, transforms
from tb.helpers.captures import colmap, lens, text_lens, transforms_file
from tb.helpers.refusal import refused
from tb.helpers.scene_file import check_refused

PINHOLE = [510.0, 500.0, 320.0, 240.0]  # fx, fy, cx, cy

LENSES = {
    "SIMPLE_PINHOLE": 0, "PINHOLE": 0, "SIMPLE_RADIAL": 1, "RADIAL": 2, "OPENCV": 4,
    "FULL_OPENCV": 8, "FOV": 1, "SIMPLE_DIVISION": 1, "DIVISION": 1,
}  # fmt: skip
"""Models that are pinholes if all distortion is 0 → number of distortion coefficients."""

ONE_FOCAL = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_DIVISION")


@pytest.mark.parametrize("files", [lens, text_lens])
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
        refused(rf"cameras\.\w+: camera 4: {model} has \w+ = -0.25", read_cameras, tmp_path / "bad")


@pytest.mark.parametrize("beta", [1.0, 0.5])
def test_unified_camera_model(tmp_path, beta):
    """alpha is the distortion; beta has no effect if alpha is 0."""
    colmap(tmp_path / "0", lens("EUCM", *PINHOLE, 0.0, beta))
    assert read_cameras(tmp_path)[0].fx == PINHOLE[0]
    colmap(tmp_path / "1", lens("EUCM", *PINHOLE, 0.5, beta))
    check_refused(read_cameras, tmp_path / "1", "camera 4: EUCM has alpha = 0.5")


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
    check_refused(read_cameras, tmp_path, f"camera 4: model {model} is not supported")


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
