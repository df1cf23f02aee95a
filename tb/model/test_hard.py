"""Every hard case really has the property that makes it hard."""

import warnings

import numpy as np
import pytest

from splatcore.golden.reference import Frame, harmonics, project, render
from splatcore.model.generate.hard import HARD, HardCase
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.metric import psnr
from splatcore.spec.colour import FINE, SECOND
from splatcore.spec.convention import (
    ALPHA_MAX,
    ALPHA_MIN,
    COLOUR_OFFSET,
    NEAR_PLANE,
    TILE,
    TRANSMITTANCE_MIN,
)
from splatcore.spec.scene import ARRAYS, rotation_matrix
from tb.helpers.bounds import HARMONICS

NAMES = [
    *("antialiased_dust", "antialiased_needles", "antialiased_edge", "antialiased_edge_on"),
    "antialiased_whole",
    *("fog", "alternating_layers"),
    *("swinging_harmonics", "clamped_harmonics", "at_the_poles", "at_the_camera"),
    *("outlying_coefficient", "mixed_degrees", "zero_bands"),
    *("needles", "flakes", "whole_screen", "sub_pixel", "equal_depths", "long_list"),
    *("depth_range", "near_plane", "camera_inside", "far_from_origin", "opacity_edge"),
    *("transmittance_edge", "saturated_colours", "zero_scales", "unnormalised_quaternions"),
    *("not_finite", "empty", "one", "odd_size", "one_pixel"),
]

BALANCED_DB = {
    "swinging_harmonics": 22, "clamped_harmonics": 28, "at_the_poles": 36, "at_the_camera": 30,
    "outlying_coefficient": 30, "mixed_degrees": 33, "zero_bands": 35,
}  # fmt: skip
"""Minimum PSNR in dB against the scene of `balanced` models: at most two beats per Gaussian."""


@pytest.fixture
def case(request) -> HardCase:
    """The hard case that the test is named after."""
    return HARD[request.node.name.removeprefix("test_")](0)


def rendered(case: HardCase) -> Frame:
    with warnings.catch_warnings():  # an infinite quaternion has no rotation
        warnings.simplefilter("ignore", RuntimeWarning)
        return render(case.scene.gaussians(), case.camera)


def in_camera(case: HardCase) -> np.ndarray:
    """Positions [N, 3] in camera space."""
    return case.scene.position @ case.camera.rotation.T + case.camera.translation


def on_screen(case: HardCase) -> np.ndarray:
    """Pixel coordinates [N, 2] of the centres."""
    x, y, z = in_camera(case).T
    c = case.camera
    return np.stack([c.fx * x / z + c.cx - 0.5, c.fy * y / z + c.cy - 0.5], axis=1)


def most_in_a_tile(case: HardCase, chosen: np.ndarray) -> int:
    """Number of `chosen` centres in the fullest tile."""
    tile = np.floor((on_screen(case)[chosen] + 0.5) / TILE).astype(int)
    return np.unique(tile, axis=0, return_counts=True)[1].max()


def ratio(case: HardCase, axis: int) -> np.ndarray:
    """Ratio [N] of the largest scale to the scale of rank `axis`."""
    scale = np.sort(case.scene.scale, axis=1)[:, ::-1]
    return scale[:, 0] / scale[:, axis]


def test_all_cases_are_there():
    assert list(HARD) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_renders_and_repeats(name):
    """A case is small, renders finite pictures, and depends on the seed alone."""
    case, again, other = HARD[name](0), HARD[name](0), HARD[name](1)
    for array in ARRAYS:
        first, second = getattr(case.scene, array), getattr(again.scene, array)
        assert np.array_equal(first, second, equal_nan=True), array
    assert "\n" not in case.about and 30 < len(case.about) < 100
    c = case.camera
    assert c.width * c.height <= 64 * 48
    assert np.isfinite(rendered(case).image).all()
    if name not in ("empty", "one"):
        assert len(case.scene) == len(other.scene)
        pairs = [(getattr(case.scene, array), getattr(other.scene, array)) for array in ARRAYS]
        assert not all(np.array_equal(*pair, equal_nan=True) for pair in pairs)


def test_needles(case):
    assert np.allclose(ratio(case, 1), 1e5) and np.allclose(ratio(case, 2), 1e5)
    assert rendered(case).counts["visible"] == len(case.scene)


def test_flakes(case):
    assert np.allclose(ratio(case, 1), 1) and np.allclose(ratio(case, 2), 1e5)
    thin = rotation_matrix(case.scene.quaternion)[:, :, 2]
    assert np.sum(np.abs(np.sum(thin * [0, 0, 1], axis=1)) < 1e-9) >= 20  # edge-on


def test_whole_screen(case):
    splats, _ = project(case.scene.gaussians(), case.camera)
    low, high = splats.centre - splats.extent, splats.centre + splats.extent
    covers = (low < 0).all(axis=1) & (high > [case.camera.width, case.camera.height]).all(axis=1)
    assert covers.sum() >= 5
    assert splats.extent.max() > 20 * case.camera.width


def test_sub_pixel(case):
    pixels = case.scene.scale.max(axis=1) * case.camera.fx / in_camera(case)[:, 2]
    assert pixels.max() <= 0.1 and pixels.min() < 1e-3
    assert rendered(case).counts["visible"] == len(case.scene) >= 1_000


def test_equal_depths(case):
    depth = in_camera(case)[:, 2]
    values, counts = np.unique(depth.view(np.int64), return_counts=True)
    same = depth.view(np.int64) == values[counts.argmax()]
    assert most_in_a_tile(case, same) >= 2_000
    image = rendered(case).image
    backwards = HardCase(case.scene[::-1], case.camera, case.about)
    assert np.abs(rendered(backwards).image - image).max() > 0.01  # storage order decides


def test_long_list(case):
    frame = rendered(case)
    assert len(case.scene) == 20_000 == most_in_a_tile(case, np.ones(20_000, bool))
    assert frame.tile_list.max() == 20_000
    assert frame.counts["pixels_ended"] == 0  # the whole list is walked
    assert frame.transmittance.min() > 10 * TRANSMITTANCE_MIN


def test_depth_range(case):
    depth = in_camera(case)[:, 2]
    assert most_in_a_tile(case, np.ones(len(depth), bool)) == len(depth)
    assert depth.min() == np.nextafter(NEAR_PLANE, 1) and depth.max() == 20_000
    assert rendered(case).counts["visible"] == len(depth)
    assert np.histogram(np.log10(depth), 10)[0].min() >= 50  # every half decade is used


def test_near_plane(case):
    depth = in_camera(case)[:, 2]
    for value in (NEAR_PLANE, np.nextafter(NEAR_PLANE, 1), np.nextafter(NEAR_PLANE, 0)):
        assert np.sum(depth == value) >= 3
    reach = 3 * case.scene.scale.max(axis=1)
    crossing = np.abs(depth - NEAR_PLANE) < reach
    assert np.sum(crossing & (depth > NEAR_PLANE)) >= 8
    assert np.sum(crossing & (depth < NEAR_PLANE)) >= 4
    culled = rendered(case).counts["near_culled"]
    assert culled == np.sum(depth <= NEAR_PLANE) and 0 < culled < len(depth) / 2


def test_camera_inside(case):
    rotation = rotation_matrix(case.scene.quaternion)
    offset = case.camera.position - case.scene.position
    local = np.einsum("nij,ni->nj", rotation, offset) / case.scene.scale
    inside = np.linalg.norm(local, axis=1) < 2  # standard deviations
    depth = in_camera(case)[:, 2]
    assert np.sum(inside & (depth > NEAR_PLANE)) >= 3
    assert np.sum(inside & (depth <= NEAR_PLANE)) >= 3


def test_far_from_origin(case):
    assert np.abs(case.scene.position).min() > 5e3
    assert np.linalg.norm(in_camera(case), axis=1).max() < 20
    assert rendered(case).counts["visible"] > 200


def test_opacity_edge(case):
    centre = on_screen(case)
    assert np.array_equal(centre, np.rint(centre))  # exactly on pixel centres
    opacity = case.scene.opacity
    for value in (ALPHA_MIN, ALPHA_MAX, 1.0):
        assert np.sum(opacity == value) >= 3
        assert np.sum(opacity == np.nextafter(value, 0)) >= 3
    for value in (ALPHA_MIN, ALPHA_MAX, 0.0):
        assert np.sum(opacity == np.nextafter(value, 1)) >= 3
    left = rendered(case).transmittance[tuple(centre.astype(int).T[::-1])]
    off = opacity != ALPHA_MIN
    assert np.array_equal(left[off] < 1, opacity[off] > ALPHA_MIN)
    assert np.allclose(1 - left[left < 1], np.minimum(opacity, ALPHA_MAX)[left < 1], atol=1e-12)


def test_transmittance_edge(case):
    """After four layers T is 1e-4 or within 1 % of it; a fifth would take it far below."""
    centre = on_screen(case)
    assert np.array_equal(centre, np.rint(centre))
    alpha = case.scene.opacity.reshape(5, -1)
    after = np.prod(1 - alpha[:4], axis=0)
    offset = after / TRANSMITTANCE_MIN - 1
    for low, high in ((1e-15, 1e-10), (1e-10, 1e-6), (1e-6, 2e-2)):
        assert np.sum((offset > low) & (offset < high)) >= 5, (low, high)
        assert np.sum((offset < -low) & (offset > -high)) >= 5, (low, high)
    assert np.sum(np.abs(offset) < 1e-14) >= 20
    left = rendered(case).transmittance[tuple(centre[: alpha.shape[1]].astype(int).T[::-1])]
    blended = left < 2 * TRANSMITTANCE_MIN
    clear = np.abs(offset) > 1e-12
    assert np.array_equal(blended[clear], offset[clear] > 0)


def test_saturated_colours(case):
    image = rendered(case).image
    assert (image > 1.5).any() and (image == 0).any()
    splats, _ = project(case.scene.gaussians(), case.camera)
    assert np.mean(splats.colour == 0) > 0.2 and np.mean(splats.colour > 1) > 0.2
    base = 0.5 + 0.28209479177387814 * case.scene.sh[splats.index, 0]
    assert np.sum((base > 0) & (splats.colour == 0)) > 10  # clamped because of the direction


def test_zero_scales(case):
    zeros = np.sum(case.scene.scale == 0, axis=1)
    assert all(np.sum(zeros == number) >= 20 for number in (1, 2, 3)) and not np.sum(zeros == 0)


def test_unnormalised_quaternions(case):
    norm = np.linalg.norm(case.scene.quaternion, axis=1)
    assert np.sum(norm == 0) >= 5 and norm[norm > 0].min() < 1e-5 and norm.max() > 1e5
    assert np.mean(np.abs(norm - 1) < 0.01) < 0.05


def test_not_finite(case):
    bad = {a: ~np.isfinite(getattr(case.scene, a)).reshape(300, -1).all(axis=1) for a in ARRAYS}
    for array, rows in bad.items():
        values = getattr(case.scene, array)[rows]
        assert rows.sum() == 3, array
        for kind in (np.isnan, np.isposinf, np.isneginf):
            assert kind(values).any(), array
    counts = rendered(case).counts
    assert counts["not_finite"] == 15 and counts["visible"] == 285


def test_empty_and_one():
    empty, one = HARD["empty"](0), HARD["one"](0)
    assert len(empty.scene) == 0 and empty.scene.sh.shape == (0, 4, 3)
    assert not rendered(empty).image.any()
    assert len(one.scene) == 1 and rendered(one).counts["visible"] == 1
    assert rendered(one).image.max() > 0.5


def test_odd_sizes():
    odd, pixel = HARD["odd_size"](0).camera, HARD["one_pixel"](0).camera
    assert odd.width % TILE and odd.height % TILE and odd.width % 4 and odd.height % 4
    assert (pixel.width, pixel.height) == (1, 1)
    assert rendered(HARD["odd_size"](0)).tile_list.shape == (2, 3)
    assert rendered(HARD["one_pixel"](0)).counts["contributions"] > 5


def test_swinging_harmonics(case):
    colours = over_the_sphere(case)
    assert colours.min() < -2 and colours.max() > 3


def test_clamped_harmonics(case):
    assert 0.4 < (over_the_sphere(case) < 0).mean() < 0.6


def test_at_the_poles(case):
    x, y, _ = in_camera(case).T
    assert (x == 0).sum() == 200 == (y == 0).sum()
    assert ((x == 0) & (y == 0)).sum() == 100


def test_at_the_camera(case):
    x, y, depth = in_camera(case).T
    assert np.sum((x == 0) & (y == 0) & (depth == 0)) == 30
    behind = np.abs(depth) < 1e-5
    close = (depth > NEAR_PLANE) & (depth <= 2 * NEAR_PLANE)
    assert behind.sum() == 60 == rendered(case).counts["near_culled"] and close.sum() == 100


def test_outlying_coefficient(case):
    sizes = np.sort(np.abs(case.scene.sh[:, 1:]).ravel())
    assert sizes[-1] >= 1000 * sizes[-2]


def test_mixed_degrees(case):
    model, _ = pack(case.scene, quality="faithful")
    assert list(model.chunks["harmonics"]) == [FINE, SECOND]
    degree = (case.scene.sh[:, [1, 4, 9]] != 0).any(2).sum(1)
    assert np.bincount(degree).min() > 50


def test_zero_bands(case):
    model, _ = pack(case.scene, quality="faithful")
    assert list(model.chunks["harmonics"]) == [FINE, 0]
    third = case.scene.sh[:, 9:].any((1, 2))
    assert third.sum() == 256 and not case.scene.sh[:, 1:9].any()


@pytest.mark.parametrize("name", HARMONICS)
def test_packing_keeps_to_its_bound(name):
    """PSNR of faithful and balanced packing meets each harmonics case's bound."""
    case = HARD[name](0)
    whole = rendered(case)
    for quality, least in (("faithful", case.packing_db), ("balanced", BALANCED_DB[name])):
        packed = render(pack(case.scene, quality=quality)[0].gaussians(), case.camera)
        assert psnr(packed.pixels / 255, whole.pixels / 255) >= least, quality
        assert packed.counts["near_culled"] == whole.counts["near_culled"]


def over_the_sphere(case: HardCase) -> np.ndarray:
    """Unclamped colours [N, 64, 3] of a case's Gaussians along random directions."""
    rays = np.random.default_rng(0).normal(size=(64, 3))
    basis = harmonics(rays / np.linalg.norm(rays, axis=1, keepdims=True), 3)
    return np.einsum("dk,nkc->ndc", basis, case.scene.sh) + COLOUR_OFFSET
