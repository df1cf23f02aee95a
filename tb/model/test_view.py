"""The default camera of a scene without cameras: it frames the object, whatever floats around."""

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.cameras.view import NEAREST, sensible_view
from splatcore.model.formats.camera_file import read_cameras
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import garden
from splatcore.spec.convention import NEAR_PLANE
from tb.helpers.round_gaussians import ball, boxes, gaussians, joined
from tb.helpers.scenes import needs_scenes, scene_path

REAL = ["leica-sofort-top8192.ply", "skull.sog", "luma-seal.splat", "kitchen.spz"]


def seen(camera, position) -> float:
    """Share of the points that are beyond the near plane and inside the image."""
    x, y, z = (position @ camera.rotation.T + camera.translation).T
    tan_x, tan_y = camera.tan_half_fov
    return np.mean((z > NEAR_PLANE) & (np.abs(x) < tan_x * z) & (np.abs(y) < tan_y * z))


def filling(camera, position) -> float:
    """Width or height of the points' bounding box relative to the image, the larger one."""
    x, y, z = (position @ camera.rotation.T + camera.translation).T
    tan_x, tan_y = camera.tan_half_fov
    return max(np.ptp(x / z) / (2 * tan_x), np.ptp(y / z) / (2 * tan_y))


def looks_down_at(camera, middle, tolerance):
    """Whether the camera aims at `middle`, upright and slightly downwards."""
    forward, down = camera.rotation[2], camera.rotation[1]
    aim = np.asarray(middle) - camera.position
    aside = np.linalg.norm(np.cross(aim, forward)) / np.linalg.norm(aim)
    return aside < tolerance and 0.2 < forward[1] < 0.4 and down[1] > 0.9


@pytest.mark.parametrize("size", [1e-1, 1.0, 300.0])
@pytest.mark.parametrize("width, height", [(1920, 1080), (640, 480), (300, 800), (37, 19)])
def test_object(size, width, height):
    middle = np.array([5.0, -2.0, 1.0]) * size
    position = ball(radius=size, middle=middle)
    camera = sensible_view(gaussians(position, 0.02 * size), width, height)
    assert (camera.width, camera.height) == (width, height)
    assert seen(camera, position) == 1.0
    assert looks_down_at(camera, middle, 0.05)
    if size >= 1:
        assert filling(camera, position) > 0.5


def test_floaters_and_shell_do_not_matter():
    subject = gaussians(ball(middle=(1, 0, 2)))
    plain = sensible_view(subject, 320, 180)
    shell = gaussians(ball(1_500, radius=150.0, seed=1), scale=20.0)
    floaters = gaussians(ball(60, (40, -20, 10), radius=9.0, seed=2))
    faint = gaussians(ball(3_000, (-6, 0, 0), radius=2.5, seed=3), opacity=0.05)
    crowded = sensible_view(joined(subject, shell, floaters, faint), 320, 180)
    assert np.linalg.norm(crowded.position - plain.position) < 0.3
    assert np.allclose(crowded.rotation, plain.rotation, atol=0.1)


def test_broken_gaussians_do_not_matter():
    position = ball()
    plain = sensible_view(gaussians(position), 320, 180)
    bad = gaussians(np.full((900, 3), 7.0), opacity=np.nan)
    worse = gaussians(np.array([[np.nan, 0, 0], [0, np.inf, 0]] * 200))
    camera = sensible_view(joined(gaussians(position), bad, worse), 320, 180)
    assert np.allclose(camera.position, plain.position)


def test_all_faint():
    position = ball()
    camera = sensible_view(gaussians(position, opacity=0.02), 320, 180)
    assert seen(camera, position) == 1.0


@pytest.mark.parametrize("scale", [0.0, 1e-3, 0.5, 20.0])
@pytest.mark.parametrize("count", [1, 50])
def test_one_place(count, scale):
    """One Gaussian, or all at one place: in the middle of the image, not around the camera."""
    place = np.array([3.0, 4.0, -5.0])
    scene = gaussians(np.tile(place, (count, 1)), scale)
    camera = sensible_view(scene, 64, 48)
    distance = np.linalg.norm(camera.position - place)
    assert distance > max(2.5 * scale, 0.99 * NEAREST)
    assert looks_down_at(camera, place, 1e-6)
    frame = render(scene, camera)
    alpha = 1 - frame.transmittance
    assert np.isclose(alpha[23:25, 31:33].max(), alpha.max(), atol=0.02) and alpha.max() > 0.2


@pytest.mark.parametrize("bad", [0, 10])
def test_nothing_to_see(bad):
    scene = gaussians(np.full((bad, 3), np.nan))
    assert seen(sensible_view(scene, 64, 48), np.zeros((1, 3))) == 1.0


def test_two_gaussians():
    position = np.array([[0.0, 0, 0], [0.0, 0, 4.0]])
    assert seen(sensible_view(gaussians(position), 320, 180), position) == 1.0


def test_broad_side():
    """A wall is seen from its broad side, not edge-on."""
    wall = boxes(4, (3_000, [0.02, 1, 2], [0, 0, 0]))
    camera = sensible_view(gaussians(wall), 320, 180)
    assert abs(camera.rotation[2, 0]) > 0.85


def test_open_side():
    """A screen between the default viewpoint and the object moves the camera around it."""
    screen = boxes(5, (200, [2.4, 1.2, 0.01], [0, -1.0, -3.2]))
    subject = gaussians(ball(20_000))
    x, _, z = sensible_view(subject, 320, 180).position
    assert abs(x) < 0.1 and z < -3.5
    x, _, z = sensible_view(joined(subject, gaussians(screen, 0.4)), 320, 180).position
    assert np.hypot(x, z) > 3.5 and (z > -3.2 or abs(x * 3.2 / z) > 2.4)


def test_room():
    """A room open at +z is seen through the open side, not from behind a wall."""
    room = boxes(
        6,
        (12_000, [2, 1.2, 0.0], [0, 0, -1.6]),
        (4_000, [0.02, 1.2, 1.6], [-2, 0, 0]),
        (4_000, [0.02, 1.2, 1.6], [2, 0, 0]),
        (4_000, [2, 0.02, 1.6], [0, 1.2, 0]),
    )
    camera = sensible_view(gaussians(room, 0.04), 320, 180)
    assert camera.rotation[2, 2] < -0.8
    assert seen(camera, room) > 0.9


def test_garden():
    """A scene with a sky shell: the camera is within it and shows the middle of the garden."""
    scene = garden(8_000)
    camera = sensible_view(scene.gaussians(), 96, 54)
    assert np.linalg.norm(camera.position) < 14 and -6 < camera.position[1] < -1
    middle = scene.position[np.linalg.norm(scene.position, axis=1) < 2.5]
    assert seen(camera, middle) > 0.85
    assert render(scene.gaussians(), camera).transmittance.max() < 0.3


@needs_scenes
@pytest.mark.parametrize("file", REAL)
def test_real_scenes(file):
    """0.5 to 3 times as far as the scene's own camera, with the opaque core in the image."""
    scene, name = read_scene(scene_path(file)), file.split(".")[0].removesuffix("-top8192")
    camera = sensible_view(scene.gaussians(), 192, 108)
    own = read_cameras(scene_path(f"{name}.cameras.json"))[0]
    opaque = scene.position[scene.opacity > 0.3]
    middle = np.median(opaque, axis=0)
    farther = np.linalg.norm(camera.position - middle) / np.linalg.norm(own.position - middle)
    assert 0.5 < farther < 3
    core = opaque[np.argsort(np.linalg.norm(opaque - middle, axis=1))[: len(opaque) // 2]]
    assert seen(camera, core) > 0.95
    lit = render(scene.gaussians(), camera).transmittance < 0.5
    assert lit.mean() > 0.05


@needs_scenes
def test_kitchen_from_its_open_side():
    """The camera looks in through +z, where the kitchen has no wall."""
    camera = sensible_view(read_scene(scene_path("kitchen.spz")).gaussians(), 192, 108)
    assert camera.rotation[2, 2] < -0.8
