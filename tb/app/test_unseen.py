"""Notes on Gaussians that a camera does not show, and the option `--near`."""

import re
from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.sim.common.notes import printing
from splatcore.sim.frame.shot import Shot
from splatcore.sim.frame.source import Source
from splatcore.sim.frame.unseen import before_near, near_note, note_empty
from splatcore.spec.camera import Camera
from splatcore.spec.scene import Scene

DEPTHS = [0.005, 0.011, 0.05, 0.199, 0.2, 0.201, 1.0, 5.0]


def source(depths=DEPTHS) -> Source:
    """A source of small opaque Gaussians on a camera's axis, and one far off the axis."""
    position = np.array([[0, 0, depth] for depth in depths] + [[9.0, 0, 0.1]])
    count = len(position)
    arrays = np.full((count, 3), 1e-3), np.tile([1.0, 0, 0, 0], (count, 1)), np.full(count, 0.9)
    return Source("x.ply", scene=Scene(position, *arrays, np.full((count, 1, 3), 0.5), "x.ply"))


def camera(**changes) -> Camera:
    return replace(Camera(64, 48, 60.0, 60.0, 32, 24, np.eye(3), np.zeros(3), "7"), **changes)


def test_gaussians_in_front_of_the_near_plane_are_counted():
    """Only Gaussians between depth 0.01 and the near plane that `--near 0.01` would show."""
    assert before_near(source(), camera()) == 4
    assert before_near(source(), camera(near=0.1)) == 2
    assert before_near(source(), camera(near=0.01)) == 0
    shown = [
        render(source().gaussians, camera(near=near)).counts["visible"] for near in (0.2, 0.01)
    ]
    assert shown[1] - shown[0] == 4
    found = near_note(source(), [camera(near=0.1), camera(name="8"), camera(near=0.01)])
    text = "camera 8: 4 Gaussians between depth 0.01 and the near plane at 0.2 are not drawn"
    text = f"{text}, as in 3DGS"
    assert found == f"{text} (1 other camera likewise); --near 0.01 draws them"
    assert near_note(source(), [camera(name="8")]) == f"{text}; --near 0.01 draws them"
    assert near_note(source([1.0]), [camera()]) == ""
    text = "camera 7: 1 Gaussian between depth 0.01 and the near plane at 0.1 is not drawn; --near"
    assert near_note(source([0.05]), [camera(near=0.1)]) == f"{text} 0.01 draws it"


def test_an_empty_picture_names_near_plane_camera_and_extent(capsys):
    with printing():
        note_empty(Shot(source(), camera()), {"visible": 1})
        note_empty(Shot(source([1, 2]), camera(near=3.0)), {"splats": 0})
    found = capsys.readouterr().err
    assert found.startswith("x.ply: no Gaussian is visible from camera 7 at (0, 0, 0) with near")
    assert "plane 3; 98 % of the scene's Gaussians are between (0, 0, 0.118) and (8.8" in found
    assert not re.search(r"\n.", found)


@pytest.mark.parametrize("near", [0.0, -1.0, 1e-6, 1e6, np.nan, np.inf])
def test_invalid_near_planes(near):
    with pytest.raises(ValueError, match=r"camera 7: near .* is not in 1e-05 … 100000"):
        camera(near=near)
