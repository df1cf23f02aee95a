"""Scenes side by side: placement, unchanged properties, choice of Gaussians, and the command."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.cameras.join import depths, in_view, side_by_side
from splatcore.model.cameras.view import core_of
from splatcore.model.formats.camera_file import cameras_json, read_cameras
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.convention import SPLATCORE
from splatcore.spec.error import InputError
from splatcore.spec.scene import ARRAYS, Scene
from tb.helpers.clouds import cloud
from tb.helpers.command import check_refused, run

LEFT, RIGHT, BEHIND = (cloud(k, 300, degree, 0.1) for k, degree in ((0, 1), (1, 2), (2, 0)))


def eye(place, focal: float) -> Camera:
    """A camera that looks at the origin."""
    return look_at(np.array(place), np.zeros(3), 160, 90, focal)


CAMERAS = eye((1.0, -0.5, -3.0), 100.0), eye((-4.0, -1.0, 2.0), 150.0)
VIEWS = list(zip((LEFT, RIGHT), CAMERAS, strict=True))


def test_each_in_its_column():
    """Each core is centred in its half, at √2 times its own camera's depth over focal length."""
    joined, camera = side_by_side(VIEWS)
    assert np.array_equal(camera.rotation, CAMERAS[0].rotation) and camera.fx == 100
    for k, (scene, own) in enumerate(VIEWS):
        middle = core_of(joined[300 * k : 300 * (k + 1)].gaussians()).middle
        x, y, z = camera.rotation @ middle + camera.translation
        assert camera.fx * x / z + camera.cx == pytest.approx(40 + 80 * k)
        assert camera.fy * y / z + camera.cy == pytest.approx(45)
        depth = (own.rotation @ core_of(scene.gaussians()).middle + own.translation)[2]
        assert z / camera.fx == pytest.approx(np.sqrt(2) * depth / own.fx)
    assert in_view(joined, camera) > 500


def test_in_view():
    """Counts Gaussians within the picture and beyond the near plane."""
    camera = Camera(160, 90, 100.0, 100.0, 80.0, 45.0, np.eye(3), np.zeros(3))
    place = np.array(
        [[0, 0, 1], [0.79, -0.44, 1], [0, 0, 0.1], [0, 0, -1], [0.81, 0, 1], [0, 0.46, 1]]
    )
    assert in_view(replace(LEFT[:6], position=place), camera) == 2


def test_nothing_is_turned():
    """Scenes are only shifted, each by one vector; coefficients that a scene lacks are 0."""
    joined, _ = side_by_side(VIEWS, BEHIND)
    assert joined.sh_degree == 2 and len(joined) == 900
    for k, scene in enumerate((LEFT, RIGHT, BEHIND)):
        part = joined[300 * k : 300 * (k + 1)]
        for name in ("scale", "quaternion", "opacity"):
            assert np.array_equal(getattr(part, name), getattr(scene, name))
        assert np.array_equal(part.with_sh_degree(scene.sh_degree).sh, scene.sh)
        assert not part.sh[:, scene.sh.shape[1] :].any()
        assert np.ptp(part.position - scene.position, axis=0) == pytest.approx(0, abs=1e-12)


def test_behind_is_not_seen():
    """A scene behind the camera changes neither the camera nor the picture."""
    odd = BEHIND[:5]
    odd = replace(odd, position=odd.position * [np.nan, 1, 1])
    unseen = Scene(*(np.concatenate([getattr(s, n) for s in (BEHIND, odd)]) for n in ARRAYS))
    (plain, camera), (joined, same) = side_by_side(VIEWS), side_by_side(VIEWS, unseen)
    assert np.array_equal(camera.translation, same.translation)
    assert np.nanmax(depths(joined[600:900], camera)) <= 1e-9
    with_it, without = (
        render(scene.gaussians(), camera, SPLATCORE).pixels for scene in (joined[:900], plain)
    )
    assert np.array_equal(with_it, without) and without.std() > 5


@pytest.mark.parametrize(
    ("count", "sizes"), [(900, (300, 300, 300)), (700, (300, 300, 100)), (301, (150, 151, 0))]
)
def test_count(count, sizes):
    """The scene behind loses Gaussians first, then all others equally, evenly over each scene."""
    joined, _ = side_by_side(VIEWS, BEHIND, count)
    ends = np.cumsum(sizes)
    for scene, part in zip((LEFT, RIGHT, BEHIND), np.split(joined.opacity, ends), strict=False):
        kept = np.flatnonzero(np.isin(scene.opacity, part))
        assert len(kept) == len(part)
        assert not len(part) or (np.ptp(np.diff(kept)) <= 1 and kept[-1] > 295)
    assert len(joined) == ends[-1]
    for wrong in (0, 901):
        with pytest.raises(InputError, match=f"count: {wrong} is not in 1 … 900, the Gaussians"):
            side_by_side(VIEWS, BEHIND, wrong)


def test_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, scene, camera in (("a", LEFT, CAMERAS[0]), ("b", RIGHT, CAMERAS[1])):
        write_ply(tmp_path / f"{name}.ply", scene)
        (tmp_path / f"{name}.cameras.json").write_text(cameras_json([camera]))
    assert run("join a.ply b.ply --behind a.ply --count 700 -o both.ply --cameras both.json") == 0
    joined, [camera] = read_scene("both.ply"), read_cameras("both.json")
    wanted, view = side_by_side(VIEWS, LEFT, 700)
    assert joined.position == pytest.approx(wanted.position, abs=1e-5)
    assert camera.translation == pytest.approx(view.translation) and camera.name == "joined"
    printed = capsys.readouterr().out
    assert (
        "700 Gaussians, SH degree 2" in printed
        and f"{in_view(wanted, view)} Gaussians in" in printed
    )
    assert run("join a.ply b.ply --count 601 -o c.ply") == 2
    assert "error: count: 601 is not in 1 … 600" in capsys.readouterr().err
    check_refused(capsys, "join a.ply none.ply -o c.ply", "none.ply")
    assert not (tmp_path / "c.ply").exists()
