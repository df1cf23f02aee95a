"""Conversion between the page's cameras and Splatcore's, in both directions; sizes and borders."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from splatcore.app.view.camera import (
    BORDER,
    camera_of,
    fitting,
    framed,
    level_up,
    pose_of,
    shape_of,
    up_of,
    within,
)
from splatcore.app.view.page import alike
from splatcore.spec.binning import fits
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.config import DEFAULT
from tb.helpers.page_client import PageCamera

PAGES = [(640, 360), (1000, 360), (500, 700), (1, 1)]


def some(seed: int) -> Camera:
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix()
    return Camera(640, 360, 411, 407, 325, 176, rotation, rng.normal(size=3), "some")


@pytest.mark.parametrize("page", PAGES)
def test_there_and_back(page):
    """A camera is the same after conversion to the page's pose and back."""
    for seed in range(20):
        camera = some(seed)
        found = camera_of(pose_of(camera, page), camera, (640, 360), "some")
        for name, value in vars(camera).items():
            if name != "name":
                np.testing.assert_allclose(getattr(found, name), value, rtol=1e-12, atol=1e-12)


def test_the_page_s_upper_edge():
    """A point at the page's upper edge projects to the picture's upper edge, above it if the page
    is much higher than the picture, or below it if the picture fills a page of another shape."""
    camera = look_at((0.0, 0, 0), (0.0, 0, 1), 640, 360, 400.0)
    for page, row in ((640, 360), 0), ((1280, 720), 0), ((800, 360), 36), ((640, 720), -180):
        pose = pose_of(camera, page)
        up = pose.rotation @ (0, -np.tan(pose.fov / 2), 1) + pose.position
        x, y, z = camera.rotation @ up + camera.translation
        assert camera.fy * y / z + camera.cy == pytest.approx(row)
        assert camera.fx * x / z + camera.cx == pytest.approx(320)


def test_another_size():
    camera = some(1)
    found = camera_of(pose_of(camera, (800, 600)), camera, (1920, 1080))
    assert not alike(found, camera) and alike(found, found)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(found, name) == pytest.approx(3 * getattr(camera, name))


def test_the_page_s_camera_from_look_at_and_up():
    """From position, look-at and up direction the page gets the camera's rotation and tilt."""
    for seed in range(20):
        camera, up = some(seed), np.array([0.0, -1, 0])
        page = PageCamera(64, 48)
        page.position, page.up_direction = camera.position, level_up(camera, up)
        page.look_at = camera.position + 3 * camera.rotation[2]
        turned = Rotation.from_quat(page.wxyz, scalar_first=True).as_matrix()
        np.testing.assert_allclose(turned, camera.rotation.T, atol=1e-9)


def test_up():
    """Cameras are held level: `up_of` is perpendicular to all image rows and points upwards."""
    turn = Rotation.from_euler("xyz", (0.4, -1, 2)).as_matrix()
    cameras = []
    for angle in np.arange(5.0):
        eye = np.array([np.cos(angle), -0.3 * angle, np.sin(angle)])
        cameras.append(look_at(turn @ eye, np.zeros(3), 64, 48, 50.0, down=turn @ (0, 1, 0)))
    np.testing.assert_allclose(up_of(cameras), turn @ (0, -1, 0), atol=1e-3)
    assert level_up(cameras[2], up_of(cameras)) @ -cameras[2].rotation[1] > 0.05


BORDERS = [((64, 48), 0, 0), ((64, 96), 24, 0), ((256, 48), 0, 96), ((128, 96), 0, 0)]


@pytest.mark.parametrize(("page", "top", "left"), BORDERS)
def test_borders(page, top, left):
    """`framed` centres a picture on a page of another shape, between borders."""
    pixels = np.random.default_rng(0).integers(100, 256, (48, 64, 3), np.uint8)
    whole = framed(pixels, (64, 48), page)
    height, width = whole.shape[:2]
    assert width * page[1] == height * page[0]
    np.testing.assert_array_equal(whole[top : top + 48, left : left + 64], pixels)
    assert (whole == BORDER).sum() == whole.size - pixels.size


FILLED = [((48, 48), 48, 48), ((64, 40), 40, 64), ((88, 48), 35, 64), ((500, 500), 48, 48)]


@pytest.mark.parametrize(("page", "high", "wide"), FILLED)
def test_filled(page, high, wide):
    """A picture fills a page of a similar shape: its middle is shown, without borders."""
    pixels = np.random.default_rng(0).integers(100, 256, (48, 64, 3), np.uint8)
    whole, (top, left) = framed(pixels, (64, 48), page), ((48 - high) // 2, (64 - wide) // 2)
    np.testing.assert_array_equal(whole, pixels[top : top + high, left : left + wide])


def test_pixels_that_are_not_square():
    """A picture of half as many columns has the same shape on the page, and the same view."""
    camera, pixels = some(3), np.zeros((48, 32, 3), np.uint8)
    narrow = camera.resized(320, 360)
    assert shape_of(narrow) == pytest.approx(shape_of(camera))
    for page in PAGES:
        assert pose_of(narrow, page).fov == pytest.approx(pose_of(camera, page).fov)
    assert framed(pixels, (64, 48), (640, 480)).shape == (48, 32, 3)
    assert framed(pixels, (64, 48), (480, 480)).shape == (48, 24, 3)
    assert framed(pixels, (64, 48), (64, 96)).shape == (96, 32, 3)


def test_within():
    assert within((1920, 1080), (960, 540)) == (960, 540)
    assert within((640, 360), (64, 64)) == (64, 36) and within((60, 20), (64, 64)) == (60, 20)
    assert within((8000, 10), (64, 64)) == (64, 1)


def test_fitting():
    """Sizes that fit stay, portrait or landscape; larger ones shrink to the largest that fits."""
    for size in ((1920, 1080), (1080, 1920), (64, 2047), (1, 1)):
        assert fitting(DEFAULT, size) == size
    width, height = fitting(DEFAULT, (3840, 2160))
    assert fits(DEFAULT, width, height) and abs(width * 9 - height * 16) < 16 and width > 1900
