"""Views around a scene without photographs: positions, coverage, bad arguments."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from splatcore.golden.reference import project
from splatcore.model.cameras.surround import perturbed, surrounding_views
from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.scene import Gaussians, Scene
from tb.helpers.refusal import refused
from tb.helpers.round_gaussians import ball, boxes, gaussians, joined
from tb.helpers.scenes import needs_scenes, scene_path

VIEWS = 48
REAL = "flowers.spz playbot.spz skull.sog leica-sofort-top8192.ply kitchen.spz".split()


def eyes(views) -> np.ndarray:
    return np.array([camera.position for camera in views])


def hits(scene: Gaussians, views) -> np.ndarray:
    """Number [N] of views in which each Gaussian is visible."""
    count = np.zeros(len(scene), int)
    for camera in views:
        count[project(scene, camera)[0].index] += 1
    return count


def numbers(views) -> np.ndarray:
    return np.array([[*camera.rotation.flat, *camera.translation, camera.fx] for camera in views])


@pytest.mark.parametrize("count, width, height", [(1, 64, 48), (9, 30, 80), (48, 1920, 1080)])
def test_count_and_size(count, width, height):
    views = surrounding_views(gaussians(ball(500)), count, width, height)
    assert len(views) == count
    assert {(camera.width, camera.height) for camera in views} == {(width, height)}
    assert len({camera.name for camera in views}) == count
    for camera in views:
        angle = 2 * np.degrees(np.arctan(max(camera.tan_half_fov)))
        assert 40 <= angle <= 75 and camera.fx == camera.fy
        assert camera.rotation[1, 1] > 0  # upright: y points down


def test_a_seed_decides():
    scene = gaussians(ball(500))
    one, same, other = (numbers(surrounding_views(scene, 12, 64, 36, s)) for s in (3, 3, 4))
    assert np.array_equal(one, same)
    apart = np.linalg.norm(one[:, None, 9:12] - other[None, :, 9:12], axis=2)
    assert apart.min() > 1e-3  # no view in common, so another seed's views can be held out


def test_all_round_an_object_and_not_inside():
    """From every side, mostly above, outside the hollow ball; each part is in two views."""
    middle = np.array([5.0, -2, 1])
    scene = gaussians(ball(4_000, middle))
    views = surrounding_views(scene, VIEWS, 96, 54)
    away = eyes(views) - middle
    assert np.linalg.norm(away, axis=1).min() > 1
    assert away[:, 1].max() < 1 and np.mean(away[:, 1] < 0) > 0.75  # mostly from above
    turn = np.sort(np.arctan2(away[:, 0], away[:, 2]))
    gaps = np.diff([*turn, turn[0] + 2 * np.pi])
    assert gaps.max() < np.radians(45)
    assert np.mean(hits(scene, views) >= 2) > 0.99


def test_room_is_seen_from_inside_and_not_through_walls():
    """A room open at +z: some cameras are inside, none is behind a wall."""
    walls = boxes(
        6,
        (4_000, [2, 1.2, 0.02], [0, 0, -1.6]),
        (3_000, [0.02, 1.2, 1.6], [-2, 0, 0]),
        (3_000, [0.02, 1.2, 1.6], [2, 0, 0]),
        (3_000, [2, 0.02, 1.6], [0, 1.2, 0]),
    )
    scene = gaussians(walls, 0.07)
    views = surrounding_views(scene, VIEWS, 96, 54)
    x, y, z = eyes(views).T
    above = y < -1.2  # there is no ceiling
    assert (above | (z > -1.6)).all()
    assert (above | (z > 1.6) | (np.abs(x) < 2)).all()
    assert np.sum(~above & (np.abs(x) < 2) & (np.abs(z) < 1.6)) >= VIEWS // 8
    assert np.mean(hits(scene, views) >= 2) > 0.95


def test_a_screen_is_not_looked_at():
    """A screen in front of the object removes the views that it would block."""
    screen = boxes(5, (225, [1.2, 1.5, 0.01], [0, -0.6, -1.5]))
    subject = gaussians(ball(5_000), 0.1)

    def behind(scene):
        x, y, z = eyes(surrounding_views(scene, VIEWS, 96, 54)).T
        return np.sum((z < -1.6) & (np.abs(x) < 0.4 * -z) & (y > -1.2))

    assert behind(subject) >= 3
    assert behind(joined(subject, gaussians(screen, 0.2))) == 0


def test_what_cannot_be_seen_does_not_matter():
    """Any number of transparent or broken Gaussians changes no view."""
    scene = gaussians(ball(500))
    bad = gaussians(np.tile([[np.nan, 0, 0], [0, np.inf, 0]], (700, 1)))
    clear = gaussians(ball(9_000, radius=50.0), opacity=0.003)
    odd = gaussians(ball(900, radius=30.0), opacity=np.nan)
    wide = gaussians(ball(900, radius=20.0), scale=np.inf)
    plain = surrounding_views(scene, 6, 64, 36)
    views = surrounding_views(joined(scene, bad, clear, odd, wide), 6, 64, 36)
    assert np.allclose(eyes(views), eyes(plain))


@pytest.mark.parametrize("scale", [0.0, 0.5])
@pytest.mark.parametrize("count", [1, 2])
def test_one_place(count, scale):
    place = np.array([3.0, 4, -5])
    scene = gaussians(np.tile(place, (count, 1)), scale)
    views = surrounding_views(scene, 8, 64, 36)
    assert (hits(scene, views) == 8).all()


NOTHING = [gaussians(np.zeros((0, 3))), gaussians(np.full((5, 3), np.nan))]
NOTHING += [gaussians(ball(5), opacity=opacity) for opacity in (0.0, np.nan)]
NOTHING += [gaussians(ball(5), scale=np.inf)]


@pytest.mark.parametrize("scene", NOTHING)
def test_nothing_to_see(scene):
    refused("no Gaussian can be seen", surrounding_views, scene, 4, 64, 36)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ((0, 64, 36), "count: 0 is below 1"),
        ((4, 64, 36, -1), "seed: -1 is below 0"),
        ((4, 0, 36), "width: 0 is not in 1"),
        ((4, 64, 9000), "height: 9000 is not in 1"),
    ],
)
def test_bad_arguments(arguments, message):
    refused(message, surrounding_views, gaussians(ball(50)), *arguments)


def test_garden():
    """Over 95 % of what the garden's own camera sees is in two views; all are above the ground."""
    scene = generate("garden", 8_000).gaussians()
    views = surrounding_views(scene, VIEWS, 96, 54)
    own = project(scene, generated_camera("garden", 96, 54))[0].index
    assert np.mean(hits(scene, views)[own] >= 2) > 0.95
    assert eyes(views)[:, 1].max() < 0


def test_perturbed():
    """Shifts and turns reach but keep their bounds, in all directions; the lens does not change."""
    camera = look_at([1, -2, -4], [0.2, 0, 0], 64, 36, 50.0, name="a")
    camera = replace(camera, cx=30.5)
    rng = np.random.default_rng(1)
    others = [perturbed(camera, 0.5, 0.1, rng) for _ in range(400)]
    step = eyes(others) - camera.position
    length = np.linalg.norm(step, axis=1)
    assert length.max() <= 0.5 and length.max() > 0.48 and length.min() < 0.02
    assert (np.abs((step > 0).mean(axis=0) - 0.5) < 0.1).all()
    between = np.array([other.rotation @ camera.rotation.T for other in others])
    assert np.abs(between @ between.swapaxes(1, 2) - np.eye(3)).max() < 1e-12
    turn = np.arccos(np.clip((np.trace(between, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert turn.max() <= 0.1 + 1e-9 and turn.max() > 0.095 and turn.min() < 0.005
    for other in others[:3]:
        for field in ("width", "height", "fx", "fy", "cx", "cy", "name"):
            assert getattr(other, field) == getattr(camera, field), field
    still = perturbed(camera, 0.0, 0.0, rng)
    assert np.allclose(numbers([still]), numbers([camera]), atol=1e-12)


@cache
def real_scene(file: str) -> tuple[Scene, list[Camera]]:
    """A real scene, and views around it."""
    whole = read_scene(scene_path(file))
    return whole, surrounding_views(whole.gaussians(), VIEWS, 480, 270)


@needs_scenes
@pytest.mark.slow
@pytest.mark.parametrize("file", REAL)
def test_views_hold_what_the_scenes_cameras_see(file):
    """At least 95 % of what each of a scene's own cameras sees is in two or more of 48 views."""
    (whole, views), name = real_scene(file), file.split(".")[0].removesuffix("-top8192")
    some = whole[:: max(len(whole) // 8_000, 1)].with_sh_degree(0).gaussians()
    count = hits(some, views)
    for camera in read_cameras(scene_path(f"{name}.cameras.json")):
        own = project(some, camera.resized(480, 270))[0].index
        assert np.mean(count[own] >= 2) >= 0.95, camera.name


@needs_scenes
def test_kitchen_from_inside():
    """Some cameras are within the room: opaque matter on both sides along x and z."""
    scene, views = real_scene("kitchen.spz")
    solid = scene.position[scene.opacity > 0.5]
    low, high = np.percentile(solid, (10, 90), axis=0)
    place = eyes(views)
    inside = ((place > low) & (place < high))[:, [0, 2]].all(axis=1)
    assert inside.sum() >= VIEWS // 8
