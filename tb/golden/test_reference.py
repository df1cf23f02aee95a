"""The reference renderer against a plain loop over pixels and Gaussians: no tiles, no C++."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import project, render
from splatcore.golden.reference_tiles import smallest_q
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.convention import ORIGINAL, SPLATCORE, Faint
from splatcore.spec.scene import Gaussians, Scene
from tb.helpers.clouds import camera, cloud


def plain_render(gaussians: Gaussians, view: Camera, convention=SPLATCORE):
    """Blend every Gaussian into every pixel, in depth order.

    Returns the image, the transmittance, `touched` and the number of contributions. `touched[n]`
    is the mask of live pixels at which Gaussian n is visible, in depth order.
    """
    point = gaussians.position @ view.rotation.T + view.translation
    order = sorted(range(len(point)), key=lambda n: (point[n, 2], n))
    y, x = np.mgrid[: view.height, : view.width].astype(float)
    image = np.zeros((view.height, view.width, 3))
    rest = np.ones((view.height, view.width))
    live = np.ones((view.height, view.width), bool)
    touched, blended = {}, 0
    for n in order:
        px, py, pz = point[n]
        if pz <= view.near:
            continue
        limit_x = convention.frustum_margin * view.width / (2 * view.fx)
        limit_y = convention.frustum_margin * view.height / (2 * view.fy)
        tx = pz * min(max(px / pz, -limit_x), limit_x)
        ty = pz * min(max(py / pz, -limit_y), limit_y)
        x_row = [view.fx / pz, 0, -view.fx * tx / pz**2]
        jacobian = np.array([x_row, [0, view.fy / pz, -view.fy * ty / pz**2]])
        half = jacobian @ view.rotation @ gaussians.factor[n]
        conic = np.linalg.inv(half @ half.T + convention.covariance_blur * np.eye(2))
        strength = gaussians.opacity[n]
        if gaussians.antialiased:
            strength = strength * compensation(half, convention.covariance_blur)
        dx = x - (view.fx * px / pz + view.cx - 0.5)
        dy = y - (view.fy * py / pz + view.cy - 0.5)
        q = conic[0, 0] * dx**2 + 2 * conic[0, 1] * dx * dy + conic[1, 1] * dy**2
        alpha = np.minimum(convention.alpha_max, strength * np.exp(-q / 2))
        hit = live & (alpha >= convention.alpha_min)
        weight, following = rest * alpha, rest * (1 - alpha)
        if rule := convention.faint:
            hit &= (rest >= rule.dark) | (weight >= rule.taken)
            last = hit & (following < rule.ends)
            weight, following = np.where(last, rest, weight), np.where(last, 0, following)
            touched[n] = hit
        else:
            last = hit & (following < convention.transmittance_min)
            touched[n], hit = hit, hit & ~last
        live &= ~last
        blended += int(hit.sum())
        direction = gaussians.position[n] - view.position
        dirx, diry, dirz = direction / np.linalg.norm(direction)
        c0, c1 = 0.28209479177387814, 0.4886025119029199
        sh = gaussians.sh[n]
        colour = 0.5 + c0 * sh[0]
        if len(sh) > 1:
            colour = colour - c1 * diry * sh[1] + c1 * dirz * sh[2] - c1 * dirx * sh[3]
        image += np.where(hit, weight, 0)[..., None] * np.maximum(colour, 0)
        rest = np.where(hit, following, rest)
    return image, rest, touched, blended


def compensation(half: np.ndarray, blur: float) -> float:
    """Return √(det Σ / det(Σ + blur)) of Σ = half·halfᵀ [2, 2], from its singular values: they keep
    the digits that determinants lose by cancellation."""
    axes = np.linalg.svd(half, compute_uv=False)
    return float(np.prod(axes / np.sqrt(axes**2 + blur)))


RULES = {
    "3DGS": SPLATCORE,
    "faint": replace(SPLATCORE, faint=Faint(dark=0.3, taken=0.04, ends=0.1)),
}


@pytest.mark.parametrize("antialiased", [False, True])
@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize("size", [(37, 21), (16, 16), (1, 1), (64, 3)])
@pytest.mark.parametrize("seed", range(4))
def test_equals_plain_renderer(seed, size, rule, antialiased):
    gaussians, view = cloud(seed).gaussians(), camera(*size)
    gaussians = replace(gaussians, antialiased=antialiased)
    frame = render(gaussians, view, rule)
    image, rest, touched, blended = plain_render(gaussians, view, rule)
    np.testing.assert_allclose(frame.image, image, atol=1e-12)
    np.testing.assert_allclose(frame.transmittance, rest, atol=1e-13)
    assert frame.counts["contributions"] == blended
    pixels = ((n, y, x) for n, hit in touched.items() for y, x in zip(*hit.nonzero(), strict=True))
    blocks = {(n, y // 4, x // 4) for n, y, x in pixels}
    assert frame.counts["blocks"] == len(blocks)
    pairs = {(n, y // 4, x // 4) for n, y, x in blocks}
    assert frame.counts["pairs_after_termination"] >= len(pairs)
    assert frame.counts["pairs"] <= max(1.4 * len(pairs), len(pairs) + 40)
    assert frame.tile_list.sum() == frame.counts["pairs"]


def test_opaque_scene_ends_pixels():
    scene = cloud(9, count=400)
    scene.opacity[:] = 1.0
    gaussians, view = scene.gaussians(), camera()
    frame = render(gaussians, view)
    image, rest, _, _ = plain_render(gaussians, view)
    assert frame.counts["pixels_ended"] > 500
    assert frame.counts["pairs_after_termination"] < frame.counts["pairs"]
    np.testing.assert_allclose(frame.image, image, atol=1e-12)
    assert rest.min() >= SPLATCORE.transmittance_min


def test_wide_view_uses_the_frustum_margin():
    gaussians = cloud(3, spread=2.0).gaussians()
    view = look_at(np.array([0.0, 0.0, -0.5]), np.zeros(3), 32, 24, 9.0)
    frame = render(gaussians, view)
    np.testing.assert_allclose(frame.image, plain_render(gaussians, view)[0], atol=1e-12)
    other = render(gaussians, view, replace(SPLATCORE, frustum_margin=1.0))
    assert np.abs(other.image - frame.image).max() > 1e-3


def straight(depths, opacity=0.6, scale=0.1) -> Gaussians:
    """Return Gaussians on the axis of `axis_camera`, each with its own colour."""
    count = len(depths)
    position = np.stack([np.zeros(count), np.zeros(count), np.asarray(depths, float)], axis=1)
    sh = np.random.default_rng(1).normal(0, 1, (count, 1, 3))
    return Scene(
        position, np.full((count, 3), scale), np.tile([1.0, 0, 0, 0], (count, 1)),
        np.full(count, opacity), sh,
    ).gaussians()  # fmt: skip


def axis_camera() -> Camera:
    return Camera(17, 17, 20, 20, 8.5, 8.5, np.eye(3), np.zeros(3))


def test_ties_keep_storage_order():
    gaussians = straight([1.0] * 8)
    image = render(gaussians, axis_camera()).image
    np.testing.assert_allclose(image, plain_render(gaussians, axis_camera())[0], atol=1e-14)
    assert np.abs(render(gaussians[::-1], axis_camera()).image - image).max() > 0.01


def test_the_near_plane_itself_is_culled():
    counts = render(straight([0.2, np.nextafter(0.2, 1), 0.1, -5.0]), axis_camera()).counts
    assert counts["near_culled"] == 3
    assert counts["visible"] == 1


def test_centre_pixel_by_formula():
    """Two Gaussians on the centre pixel: alpha is clamped, the background shows through."""
    gaussians = straight([1.0, 2.0], opacity=1.0)
    convention = replace(SPLATCORE, background=(0.0, 0.0, 1.0))
    frame = render(gaussians, axis_camera(), convention)
    first, second = np.maximum(0.28209479177387814 * gaussians.sh[:, 0] + 0.5, 0)
    expected = 0.99 * first + 0.01 * 0.99 * second + 0.01 * 0.01 * np.array([0, 0, 1])
    np.testing.assert_allclose(frame.image[8, 8], expected, atol=1e-15)


def test_not_finite_and_overflow_are_counted():
    scene = cloud(5, count=10)
    scene.position[0, 1], scene.scale[1, 2], scene.opacity[2] = np.nan, np.inf, np.nan
    scene.position[7] = [0, 0, 1e308]
    scene.position[8], scene.scale[8] = 0, 1e200
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        frame = render(scene.gaussians(), camera())
    assert frame.counts["not_finite"] == 4
    assert np.isfinite(frame.image).all()


@pytest.mark.parametrize("convention", [SPLATCORE, ORIGINAL])
def test_no_gaussians(convention):
    frame = render(cloud(0, count=0).gaussians(), camera(5, 3), convention)
    assert frame.counts["pairs"] == 0
    assert not frame.image.any() and (frame.transmittance == 1).all()


def test_original_footprint_cuts_at_three_sigma():
    gaussians = straight([1.0], opacity=1.0, scale=1.0)  # σ = 20 px: square 61, exact 66.6
    view = Camera(193, 17, 20, 20, 110.5, 8.5, np.eye(3), np.zeros(3))
    exact, cut = render(gaussians, view).image, render(gaussians, view, ORIGINAL).image
    missing = (exact != cut).any(axis=2)
    columns = np.flatnonzero(missing.any(axis=0))
    assert list(columns) == [44, 45, 46, 47, 176] and not cut[:, [*range(32, 48), 176]].any()
    assert 1 / 255 / 2 < exact[missing].max() < 0.02


def test_result_does_not_depend_on_threads(monkeypatch):
    gaussians, view = cloud(2, count=300).gaussians(), camera(97, 65)
    frame = render(gaussians, view)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    single = render(gaussians, view)
    assert (single.image == frame.image).all()


def test_smallest_q_against_a_fine_grid():
    rng = np.random.default_rng(4)
    for _ in range(200):
        m = rng.normal(size=(2, 2)) * np.exp(rng.normal(0, 1, (2, 1)))
        form = m @ m.T + 1e-3 * np.eye(2)
        x0, y0 = rng.uniform(-3, 1, 2)
        x1, y1 = x0 + rng.uniform(0, 3), y0 + rng.uniform(0, 3)
        x, y = np.meshgrid(np.linspace(x0, x1, 200), np.linspace(y0, y1, 200))
        grid = form[0, 0] * x * x + 2 * form[0, 1] * x * y + form[1, 1] * y * y
        conic = np.array([form[0, 0], form[0, 1], form[1, 1]])
        [found] = smallest_q(conic[None], np.array([[x0, x1, y0, y1]]))
        assert found <= grid.min() + 1e-12
        assert found >= grid.min() - 0.03 * (grid.max() + 1)


def test_opacity_of_exactly_the_minimum():
    """With alpha 1/255 the centre pixel is drawn; with the next smaller opacity it is not."""
    sharp = straight([1.0], opacity=1 / 255)
    frame = render(sharp, axis_camera())
    assert frame.counts["contributions"] == 1 and frame.image[8, 8].any()
    below = render(straight([1.0], opacity=np.nextafter(1 / 255, 0)), axis_camera())
    assert below.counts["visible"] == below.counts["contributions"] == 0


def on_axis(sides, opacity=1.0) -> Gaussians:
    """Return antialiased Gaussians of sizes `sides` [N, 3] in pixels, on the centre pixel of
    `axis_camera` at depth 1."""
    count = len(sides)
    position, scale = np.tile([0.0, 0, 1], (count, 1)), np.asarray(sides, float) / 20
    turned = np.tile([1.0, 0, 0, 0], (count, 1))
    scene = Scene(position, scale, turned, np.full(count, opacity), np.zeros((count, 1, 3)))
    return replace(scene.gaussians(), antialiased=True)


@pytest.mark.parametrize("sides", [(1, 1), (0.01, 0.01), (0.3, 30), (500, 0.001), (1e-4, 2e3)])
def test_compensation_by_formula(sides):
    """For axis-aligned splats it is s₀·s₁ / √((s₀² + 0.3)·(s₁² + 0.3)); the extent follows exactly
    from the compensated opacity."""
    wanted = np.prod([side / np.sqrt(side**2 + 0.3) for side in sides])
    lowest = replace(SPLATCORE, alpha_min=1e-9)
    (splats, _) = project(on_axis([(*sides, 0.0)]), axis_camera(), lowest)
    assert splats.opacity == pytest.approx(wanted, rel=1e-12)
    assert splats.reach == pytest.approx(2 * np.log(wanted / 1e-9), rel=1e-12)
    extent = np.sqrt(splats.reach * (np.square(sides) + 0.3))
    np.testing.assert_allclose(splats.extent[0], extent, rtol=1e-12)


@pytest.mark.parametrize("length, thickness", [(500, 1e-3), (167, 0.3), (3, 1e-5), (0.01, 0.01)])
def test_compensation_of_turned_needles(length, thickness):
    """In any rotation, within 1e-9 of `compensation`, which needs no determinants."""
    rng = np.random.default_rng(7)
    turned = np.linalg.qr(rng.normal(size=(50, 3, 3)))[0]
    factor = turned * np.array([length, thickness, thickness]) / 20
    position = np.column_stack([rng.uniform(-0.4, 0.4, (50, 2)), rng.uniform(1, 2, 50)])
    gaussians = Gaussians(position, factor, np.ones(50), np.zeros((50, 1, 3)), antialiased=True)
    splats, _ = project(gaussians, axis_camera(), replace(SPLATCORE, alpha_min=1e-12))
    assert len(splats) > 30
    for splat, index in zip(splats.opacity, splats.index, strict=True):
        x, y, z = position[index]
        half = np.array([[20 / z, 0, -20 * x / z**2], [0, 20 / z, -20 * y / z**2]]) @ factor[index]
        assert splat == pytest.approx(compensation(half, 0.3), rel=1e-9)


def test_compensated_opacity_decides_what_is_visible():
    """Splats are visible from 1/255 on. Lines and points have no area, and raise no warnings."""
    one = 1 / 1.3  # of a splat of one pixel
    sides = [(1, 1, 0), (1, 1, 1), (5, 0, 0), (0, 0, 0), (1e100, 1e100, 0)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for opacity, seen in ((1.0001, [0, 1, 4]), (0.9999, [4])):
            gaussians = on_axis(sides, opacity / 255 / one)
            splats, counts = project(gaussians, axis_camera())
            assert list(splats.index) == seen and counts["visible"] == len(seen)
            image, *_ = plain_render(gaussians[:4], axis_camera())
            np.testing.assert_allclose(
                render(gaussians[:4], axis_camera()).image, image, atol=1e-14
            )
        assert not render(on_axis(sides[2:4]), axis_camera()).image.any()
        assert project(on_axis(sides[2:4]), axis_camera(), ORIGINAL)[0].opacity.tolist() == [0, 0]
