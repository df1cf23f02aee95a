"""Camera and picture sizes: large cameras, stretched pictures, a missing size; in all commands."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import splatcore
from splatcore.app.cli.view import setting_of
from splatcore.model.formats.colmap_write import write_colmap
from splatcore.sim.frame.picture import read_png
from splatcore.sim.frame.source import open_source
from splatcore.spec.camera import Camera
from splatcore.spec.config import TINY
from splatcore.spec.error import InputError
from tb.helpers.command import check_refused, run

LARGE = Camera(9504, 6336, 7425, 7425, 4752, 3168, np.eye(3), [0, 0, 3])
SMALL = LARGE.resized(60, 40)
POINTS = np.zeros((1, 3)), np.zeros((1, 3), np.uint8)


@pytest.fixture
def place(folder):
    """A folder with a scene, 64×48 cameras, and one view as captures `large`, `small`, `angle`."""
    for name, camera in {"large": LARGE, "small": SMALL}.items():
        sparse = Path(name, "sparse")
        sparse.mkdir(parents=True)
        write_colmap(sparse, [(camera, "a.png")], POINTS, [np.zeros(1, int)])
    frame = {"transform_matrix": np.diag([1, -1, -1, 1]).tolist()}
    frame["transform_matrix"][2][3] = -3
    Path("angle").mkdir()
    value = {"camera_angle_x": float(2 * np.arctan(60 / 2 / SMALL.fx)), "frames": [frame]}
    Path("angle/transforms.json").write_text(json.dumps(value))
    return folder


def lines(capsys) -> list[str]:
    """Lines of standard error."""
    return capsys.readouterr().err.splitlines()


@pytest.mark.parametrize("option", ["--camera", "--cameras"])
def test_large_cameras(place, capsys, option):
    """A picture above 8192 pixels is refused; the message names the file that holds the size."""
    where = (
        "^error: large/sparse/cameras.bin: width 9504 of camera 1 is not in 1 … 8192 .see --size"
    )
    check_refused(capsys, f"render scene.ply {option} large -o a.png", where)
    large = {"id": "x", "width": 64, "height": 9000, "fx": 60.0, "fy": 60.0}
    large |= {"position": [0, 0, 3], "rotation": np.eye(3).tolist()}
    Path("large.json").write_text(json.dumps([large]))
    where = "^error: large.json: height 9000 of camera x is not in 1 … 8192"
    check_refused(capsys, f"render scene.ply {option} large.json -o a.png", where)


def test_large_cameras_resized(place, capsys):
    """With `--size` a large camera gives the small camera's picture, without a warning."""
    for name in ("large", "small", "angle"):
        assert run(f"render scene.ply --camera {name} --size 60x40 -o {name}.png") == 0
        assert not [line for line in lines(capsys) if "stretched" in line]
    picture = read_png("large.png")
    assert picture.any()
    assert (picture == read_png("small.png")).all() and (picture == read_png("angle.png")).all()


def test_python(place):
    for name in ("large", "small", "angle"):
        [camera] = splatcore.open_cameras(name, 60, 40)
        assert np.allclose([camera.fx, camera.cx], [SMALL.fx, 30])
    [camera] = splatcore.open_cameras("large")
    scene = splatcore.open_scene("scene.ply")
    for call in (
        splatcore.render_reference,
        lambda *these: splatcore.pack(these[0], None, [these[1]]),
    ):
        with pytest.raises(InputError, match="camera: width: 9504 is not in 1 … 8192"):
            call(scene, camera)


def test_viewer(place):
    """The viewer's pictures fit the machine, however large the camera is."""
    source = open_source("scene.ply")
    for name in ("large", "small", "large/sparse"):
        setting = setting_of(source, name, None, TINY, None)
        assert setting.camera.width <= TINY.width_max and len(setting.cameras) == 1
    setting = setting_of(source, "angle", "60x40", TINY, None)
    assert (setting.cameras[0].width, setting.cameras[0].height) == (60, 40)


STRETCHED = {
    "--camera cameras.json --size 50x50": "cameras.json: camera 4: 64x48 is stretched to 50x50",
    "--camera cameras.json:7 --size 64x50": "cameras.json: camera 7: 64x48 is stretched to 64x50",
    "--cameras cameras.json --size 48x64": "cameras.json: camera 4 and 1 more: 64x48 is stretched",
    "--camera large --size 40x40": "large: camera 1: 9504x6336 is stretched to 40x40",
}


@pytest.mark.parametrize("view", STRETCHED)
def test_stretched_pictures(place, capsys, view):
    """A stretched picture gives exactly one warning, however many cameras are stretched."""
    output = "out" if "--cameras" in view else "a.png"
    assert run(f"render scene.ply {view} -o {output}") == 0
    found = [line for line in lines(capsys) if "stretched" in line]
    assert len(found) == 1 and found[0].startswith(STRETCHED[view])
    assert found[0].endswith(" (--size), fx and fy are scaled apart")


@pytest.mark.parametrize("size", ["64x48", "128x96", "33x25", "43x32", "1x1", "640x481", "641x480"])
def test_sizes_of_the_same_shape(place, capsys, size):
    """Rounding a size to whole pixels does not count as stretching."""
    assert run(f"render scene.ply --camera cameras.json --size {size} -o a.png") == 0
    assert not [line for line in lines(capsys) if "stretched" in line]


def test_stretched_scenes(place, capsys):
    """A generated scene's camera is stretched; a default view takes the aspect of `--size`."""
    assert run("render needles --size 40x40 -o a.png") == 0
    assert re.search(
        r"(?m)^needles: camera needles: \d+x\d+ is stretched to 40x40", capsys.readouterr().err
    )
    assert run("render scene.ply --size 40x40 -o a.png") == 0
    assert "stretched" not in capsys.readouterr().err


@pytest.mark.parametrize("cameras", ["cameras.json", "small"])
def test_stretched_captures(place, capsys, cameras):
    """`photographs` warns about the cameras whose path it follows."""
    command = (
        f"photographs scene.ply -o taken --views 2 --points 9 --size 24x24 --cameras {cameras}"
    )
    assert run(command) == 0
    assert len([line for line in lines(capsys) if f"{cameras}: camera" in line]) == 1


def test_a_size_that_is_missing(place, capsys):
    message = "^error: angle/transforms.json: frame 0: 'w' is missing, .*; give the size by --size"
    check_refused(capsys, "render scene.ply --camera angle -o a.png", message)
    check_refused(capsys, "render scene.ply --cameras angle -o taken", message)
