"""Views on the path of given cameras: positions, target, gaps; scenes side by side in one view:
placement, unchanged properties, choice of Gaussians, and the command."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.cameras.join import depths, in_view, side_by_side
from splatcore.model.cameras.orbit import (
    BESIDE,
    GAP,
    looked_at,
    orbiting_views,
    upright,
    views_beside,
)
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
from tb.helpers.refusal import refused

CENTRE, RADIUS, HEIGHT = np.array([1.0, -2.0, 3.0]), 4.0, 1.5
MIDDLE = np.array([9.0, 9.0, 9.0])
UPRIGHT = np.eye(3)
TILTED = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])  # a scene's axes need not be upright


def ring(count: int, frame: np.ndarray = UPRIGHT) -> list:
    """Cameras around CENTRE that look at it from above, in a rotated frame."""
    found = []
    for angle in 2 * np.pi * np.arange(count) / count + 0.3:
        eye = CENTRE + frame @ [RADIUS * np.sin(angle), -HEIGHT, RADIUS * np.cos(angle)]
        found.append(look_at(eye, CENTRE, 64, 36, 50.0, down=frame @ [0, 1, 0], name="given"))
    return found


def directions(views) -> np.ndarray:
    return np.array([view.rotation[2] for view in views])


@pytest.mark.parametrize("frame", [UPRIGHT, TILTED])
@pytest.mark.parametrize("cameras", [2, 3, 5, 7])
def test_on_the_circle(cameras, frame):
    """Each view is one of the cameras, rotated about the point that all look at."""
    given = ring(5, frame)[:cameras] if cameras < 5 else ring(cameras, frame)
    assert np.allclose(looked_at(given, MIDDLE), CENTRE, atol=0.02)
    assert np.allclose(upright(given), frame @ [0, -1, 0], atol=2e-3)
    views = orbiting_views(given, MIDDLE, 24, 0.0, 1.0)
    away = np.array([view.position for view in views]) - CENTRE
    assert np.allclose(away @ frame[:, 1], -HEIGHT, atol=0.05)
    assert np.allclose(np.linalg.norm(away, axis=1), np.hypot(RADIUS, HEIGHT), atol=0.05)
    toward = -away / np.linalg.norm(away, axis=1)[:, None]
    assert (np.sum(directions(views) * toward, axis=1) > 0.999).all()
    for view in views:
        assert np.allclose(view.rotation @ view.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(view.rotation) > 0
        assert abs(view.rotation[0] @ frame[:, 1]) < 0.01  # level
        assert (view.width, view.height, view.fx, view.cx) == (64, 36, 50.0, 32.0)


def test_all_round_and_never_where_a_camera_is():
    """Views go all round, and keep GAP to the direction of each given camera."""
    given = ring(4)
    views = orbiting_views(given, CENTRE, 48, 0.05, 1.05)
    away = np.array([view.position for view in views]) - CENTRE
    angle = np.sort(np.arctan2(away[:, 0], away[:, 2]))
    assert np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() < np.radians(15)
    between = np.arccos(np.clip(directions(views) @ directions(given).T, -1, 1))
    assert between.min() >= GAP and between.min() < 1.5 * GAP


def test_rise_and_distance():
    """Rise and distance keep their bounds, and nearly reach them."""
    views = orbiting_views(ring(3), CENTRE, 60, 0.2, 1.25)
    away = np.array([view.position for view in views]) - CENTRE
    distance = np.linalg.norm(away, axis=1)
    share = distance / np.hypot(RADIUS, HEIGHT)
    assert 0.79 < share.min() < 0.85 and 1.18 < share.max() < 1.26
    lifted = np.arcsin(-away[:, 1] / distance) - np.arctan2(HEIGHT, RADIUS)
    assert -0.205 < lifted.min() < -0.15 and 0.15 < lifted.max() < 0.205


def test_outward():
    """`outward` moves views away from the cameras' own rise, within the same bounds."""

    def rises(outward: bool) -> np.ndarray:
        views = [
            view
            for seed in range(4)
            for view in orbiting_views(ring(3), CENTRE, 60, 0.2, 1.25, seed, outward)
        ]
        away = np.array([view.position for view in views]) - CENTRE
        lifted = np.arcsin(-away[:, 1] / np.linalg.norm(away, axis=1))
        return np.abs(lifted - np.arctan2(HEIGHT, RADIUS))

    even, outward = rises(False), rises(True)
    assert np.mean(outward < 0.05) < 0.05 < 0.08 < np.mean(even < 0.05)
    assert 0.195 < outward.max() < 0.205


def test_beside_the_path():
    """Each camera gives one view of each kind: rotated about the target, up and down in turn, or
    nearer, or farther."""
    given = ring(5)
    views = views_beside(given, MIDDLE)
    assert list(views) == ["5 degrees", "15 degrees", "nearer", "farther"]
    for name, (angle, away) in BESIDE.items():
        rises = []
        for camera, view in zip(given, views[name], strict=True):
            before, after = camera.position - CENTRE, view.position - CENTRE
            old, new = np.linalg.norm(before), np.linalg.norm(after)
            assert new == pytest.approx(away * old, rel=0.01)
            assert before @ after / old / new == pytest.approx(np.cos(angle), abs=1e-3)
            assert np.allclose(view.rotation[2] * new, -after, atol=0.05)  # looks at CENTRE
            rises.append(after[1] < before[1])
        if angle:
            assert rises == [True, False, True, False, True] or rises == [False, True] * 2 + [False]


def test_one_camera_looks_at_the_middle():
    """A single camera's target is the point of its axis nearest to the middle; −y is up."""
    (camera,) = ring(1)
    middle = CENTRE + 0.5 * camera.rotation[2] + 0.3 * camera.rotation[1]
    centre = looked_at([camera], middle)
    assert np.allclose(centre, CENTRE + 0.5 * camera.rotation[2], atol=0.01)
    assert np.allclose(upright([camera]), [0, -1, 0], atol=1e-9)


def test_cameras_everywhere_leave_room():
    """The gap narrows if the cameras are denser than GAP, so the search ends."""
    given = ring(200)
    views = orbiting_views(given, CENTRE, 8, 0.0, 1.0)
    between = np.arccos(np.clip(directions(views) @ directions(given).T, -1, 1))
    assert len(views) == 8 and 0 < between.min() < GAP


def test_the_same_seed_the_same_views():
    def numbers(seed):
        views = orbiting_views(ring(4), CENTRE, 6, 0.1, 1.1, seed)
        return np.array([[*view.rotation.flat, *view.translation] for view in views])

    assert np.array_equal(numbers(0), numbers(0))
    assert not np.allclose(numbers(0), numbers(1))


def test_where_cameras_look_past_each_other():
    """If the axes do not meet, the target is the point nearest to all of them."""
    one, other = ring(4)[:2]
    other = replace(other, translation=other.translation - other.rotation @ [0, 0.2, 0])
    centre = looked_at([one, other], CENTRE)
    assert np.allclose(centre[1], CENTRE[1] + 0.1, atol=0.03)


@pytest.mark.parametrize(
    "cameras, count, message",
    [([], 3, "cameras: none given"), (ring(2), 0, "count: 0 is below 1")],
)
def test_bad_arguments(cameras, count, message):
    refused(message, orbiting_views, cameras, CENTRE, count, 0.1, 1.1)


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
