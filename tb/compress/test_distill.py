"""Distillation: least squares, teaching, its views and pictures; directions of the views, and the
slopes nearest in these directions."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.reference import render
from splatcore.model.cameras.capture import NEARER, teacher_views
from splatcore.model.cameras.orbit import GAP
from splatcore.model.cameras.surround import surrounding_views
from splatcore.model.compress import distill as distill_module
from splatcore.model.compress import teacher as teacher_module
from splatcore.model.compress.codebooks import assign_slopes, in_codebooks
from splatcore.model.compress.distill import degrees, distill, projected
from splatcore.model.compress.judge import decibels
from splatcore.model.compress.recipe import Recipe
from splatcore.model.compress.significance import ELSEWHERE, Directions, directions_of
from splatcore.model.compress.teacher import (
    packed_picture,
    pictures,
    teacher_targets,
    unpacked_picture,
)
from splatcore.model.generate.generate import generated_camera
from splatcore.model.gradients.drawn import blending_weights
from splatcore.model.gradients.finetune import Run
from splatcore.model.gradients.trainable import scene_of
from splatcore.spec.camera import Camera, look_at
from splatcore.spec.colour import SH_C0
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import COLOUR_OFFSET
from tb.helpers.compression_scene import SIZE, noted, nothing

SMALL = (48, 32)


def run(steps: int) -> Run:
    return Run("test", steps, 0.3, nothing)


def test_distilling(scene, cameras):
    """Fewer harmonics beat truncated ones by 0.1 dB after least squares, 0.3 dB after teaching."""
    strong = replace(scene, sh=np.concatenate([scene.sh[:, :4], 4 * scene.sh[:, 4:]], axis=1))
    wanted = list(pictures(strong, cameras))
    student, loss = distill(strong, 1, cameras, 1.0, Recipe(rate=0.3), run(40))
    assert scene_of(student).sh_degree == 1 and np.isfinite(loss)
    cut = decibels(strong.with_sh_degree(1), wanted)
    assert decibels(scene_of(student), wanted) > cut + 0.3
    fitted = projected(strong, 1, cameras)
    assert fitted.sh_degree == 1 and decibels(fitted, wanted) > cut + 0.1
    assert list(degrees(scene, 1)) == [2, 1] and list(degrees(scene.with_sh_degree(0), 0)) == []


def test_least_squares_of_harmonics(scene, cameras):
    """Gaussians without the higher degree, or that no camera sees, keep their harmonics."""
    bright = scene.sh.copy()
    bright[:, 0] += 3.0  # so that nothing is clamped
    bright[:, 4:] = 0
    flat = replace(scene, sh=bright)
    assert np.allclose(projected(flat, 1, cameras).sh, bright[:, :4], atol=1e-6)
    away = replace(scene, position=scene.position + 1e4)
    assert np.allclose(projected(away, 1, cameras).sh, scene.sh[:, :4])


def test_it_begins_with_least_squares(scene, cameras):
    student, loss = distill(scene, 1, cameras, 1.0, Recipe(), run(0))
    assert loss is None and np.allclose(scene_of(student).sh, projected(scene, 1, cameras).sh)


def test_colours_below_black_are_black(scene, cameras):
    """Least squares fits visible colours, which are never below zero."""
    dark = scene.sh.copy()
    dark[:, 0] = -9.0
    dark[:, 1:] = 0
    found = projected(replace(scene, sh=dark), 0, cameras).sh[:, 0]
    black = (-COLOUR_OFFSET / SH_C0 + distill_module.PULL * -9.0) / (1 + distill_module.PULL)
    seen = np.abs(found[:, 0] + 9) > 1e-6
    assert seen.mean() > 0.3 and np.allclose(found[seen], black, atol=0.2)


def test_half_of_the_steps_are_beside_the_views(scene, cameras, monkeypatch):
    """About half of the steps render views moved by at most MOVE."""
    beside, right = [], distill_module.perturbed

    def kept(camera, *arguments):
        beside.append(right(camera, *arguments))
        return beside[-1]

    monkeypatch.setattr(distill_module, "perturbed", kept)
    distill(scene, 1, cameras, 2.0, Recipe(), run(40))
    assert 12 <= len(beside) <= 28
    away = [
        min(np.linalg.norm(camera.position - own.position) for own in cameras) for camera in beside
    ]
    assert min(away) > 0 and max(away) <= 2.0 * distill_module.MOVE


def test_from_all_round(garden):
    """Without cameras the views are surrounding_views(); broken Gaussians change nothing."""
    broken = replace(garden, opacity=np.where(np.arange(700) < 3, np.nan, garden.opacity))
    targets = teacher_targets(broken, 5, SMALL, 2)
    wanted = surrounding_views(broken.gaussians(), 5, *SMALL, 2)
    for target, camera in zip(targets, wanted, strict=True):
        assert np.array_equal(target.camera.rotation, camera.rotation)
        assert np.allclose(target.camera.position, camera.position, rtol=1e-12)


def test_pictures_are_rendered_when_they_are_read(garden, monkeypatch):
    """Once while they are cached; cameras and names need no rendering."""
    drawn = noted(monkeypatch, teacher_module, "render")
    monkeypatch.setattr(teacher_module, "REMEMBERED", 2)
    targets = teacher_targets(garden, 3, SMALL, 0)
    cameras = [target.camera for target in targets]
    assert all(isinstance(target.name, str) for target in targets) and not drawn
    for k in (0, 1, 1, 0, 2, 2, 0, 1):
        assert targets[k].image.shape == (SMALL[1], SMALL[0], 3)
    assert [given[-1] for given in drawn] == [cameras[k] for k in (0, 1, 2, 1)]


def test_on_the_path_of_cameras(garden):
    """Views keep the cameras' distance and lens, and a gap to each camera's direction."""
    eyes = [np.array([3 * np.sin(a), -1.2, 3 * np.cos(a)]) for a in (0.0, 1.5, 3.0, 4.5)]
    cameras = [look_at(eye, [0, -0.3, 0], 480, 240, 400.0) for eye in eyes]
    views = teacher_views(garden.gaussians(), 20, SMALL, 0, cameras)
    away = [np.linalg.norm(view.position - [0, -0.3, 0]) for view in views]
    whole = np.hypot(3, 0.9)
    assert len(views) == 20 and max(away) / whole < NEARER * 1.01 and whole / min(away) < 1.06
    for view in views:
        assert (view.width, view.height, view.fx, view.fy) == (*SMALL, 40.0, 400 * 32 / 240)
        ahead = [camera.rotation[2] @ view.rotation[2] for camera in cameras]
        assert max(ahead) <= np.cos(GAP)


def test_beside_the_path(garden):
    """The last views leave the path: by up to 15°, few by less than a quarter of that, and by up to
    25 % of the distance."""

    def deviations(count: int, beside: float) -> tuple[np.ndarray, np.ndarray]:
        views = teacher_views(garden.gaussians(), count, SMALL, 0, cameras, beside)
        away = np.array([view.position for view in views]) - [0, -0.3, 0]
        far = np.linalg.norm(away, axis=1)
        rise = np.arcsin(-away[:, 1] / far) - np.arctan2(0.9, 3)
        return abs(np.degrees(rise)), abs(far / np.hypot(3, 0.9) - 1)

    eyes = [np.array([3 * np.sin(a), -1.2, 3 * np.cos(a)]) for a in (0.0, 1.5, 3.0, 4.5)]
    cameras = [look_at(eye, [0, -0.3, 0], 480, 240, 400.0) for eye in eyes]
    rise, far = deviations(20, 0.4)
    assert len(rise) == 20 and rise[:12].max() < 3.1 and far[:12].max() < 0.06
    assert 6 < rise[12:].max() < 15.1 and 0.1 < far[12:].max() < 0.26
    assert np.mean(deviations(60, 1.0)[0] < 15 / 4) < 0.1


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (64, 48)])
def test_kept_pictures(size):
    """Stored pictures are lossless, and smooth ones take less than half the bytes."""
    camera = look_at([0, 0, -3], [0, 0, 0], *size, 50.0)
    random = np.random.default_rng(0).integers(0, 256, (size[1], size[0], 3), np.uint8)
    smooth = np.add.outer(np.arange(size[1]), np.arange(size[0]))[..., None] * [1, 2, 3]
    for image in (random, smooth.astype(np.uint8)):
        data = packed_picture(image)
        assert np.array_equal(unpacked_picture(data, camera), image)
    assert size != (64, 48) or 2 * len(data) < image.nbytes


def test_pictures_are_the_scenes_own(garden):
    """The reference's 8-bit pictures, except for the last bit of a few pixels in float32."""
    for target in teacher_targets(garden, 3, SMALL, 0):
        apart = np.abs(target.image - render(garden.gaussians(), target.camera).pixels.astype(int))
        assert apart.max() <= 1 and apart.mean() < 0.01 and target.image.std() > 10


@pytest.fixture(scope="module")
def seen(scene, cameras) -> Directions:
    return directions_of(scene, cameras)


@pytest.fixture(scope="module")
def rays(scene, cameras) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors [N, V, 3] from the cameras, and their weights [N, V]."""
    ray = scene.position[:, None] - np.array([camera.position for camera in cameras])
    weights = blending_weights(scene.gaussians(), cameras)
    weight = np.stack(list(weights), axis=1).astype(np.float64)
    return ray / np.linalg.norm(ray, axis=2, keepdims=True), weight


def test_directions(seen, rays):
    """Weighted mean and variance of the directions, against numpy."""
    for mean, variance, ray, weight in zip(seen.mean, seen.variance, *rays, strict=True):
        if not weight.any():
            assert not mean.any() and np.allclose(variance, ELSEWHERE * np.eye(3))
            continue
        wanted = np.cov(ray.T, aweights=weight, ddof=0)
        assert np.allclose(mean, np.average(ray, axis=0, weights=weight))
        assert np.allclose(variance - ELSEWHERE * np.eye(3), wanted, atol=1e-9)
    assert (rays[1].sum(axis=1) > 0).mean() > 0.9


def test_a_gaussian_in_a_camera(scene, cameras):
    """A Gaussian at a camera's position has no direction there, and still finite results."""
    position = scene.position.copy()
    position[3] = cameras[0].position
    found = directions_of(replace(scene, position=position), cameras)
    assert np.isfinite(found.mean).all() and np.isfinite(found.variance).all()


def test_nearest_is_nearest_in_colour(seen, rays):
    """Least squared error of colours about their mean, which the constant term can absorb."""
    rng = np.random.default_rng(0)
    ray, weight = rays
    slopes, entries = rng.normal(0, 1, (len(ray), 9)), rng.normal(0, 1, (16, 9))
    found = seen.nearest(slopes, entries)
    for n in np.flatnonzero(weight.sum(axis=1) > 0):
        off = (slopes[n] - entries).reshape(-1, 3, 3)  # [K, channel, axis]
        colour = off @ ray[n].T  # [K, channel, V]
        mean = np.average(colour, axis=2, weights=weight[n])
        about = np.average((colour - mean[..., None]) ** 2, axis=2, weights=weight[n])
        wanted = about.sum(axis=1) + ELSEWHERE * (off**2).sum(axis=(1, 2))
        assert wanted[found[n]] <= wanted.min() * (1 + 1e-9)


def test_colours_make_up_for_slopes(seen, rays):
    """The constant term absorbs lost slopes: the mean colour over the views does not change."""
    rng = np.random.default_rng(1)
    colours, missing = rng.random((len(seen.mean), 3)), rng.normal(0, 1, (len(seen.mean), 9))
    made_up = seen.compensated(colours, missing)
    ray, weight = rays
    shown = weight.sum(axis=1) > 0
    lost = np.einsum("nca,nva->nvc", missing.reshape(-1, 3, 3), ray)[shown]
    lost = np.stack(
        [np.average(a, axis=0, weights=w) for a, w in zip(lost, weight[shown], strict=True)]
    )
    assert np.allclose(made_up[shown] - colours[shown], lost)
    assert np.array_equal(made_up[~shown], colours[~shown])


def on_a_line(camera: Camera) -> list[Camera]:
    """Eight cameras on a line from left to right through this one."""
    steps = np.outer(np.linspace(-2, 2, 8), (1, 0, 0))
    return [replace(camera, translation=camera.translation + step) for step in steps]


def test_directions_improve_models(scene):
    """Absorbing lost slopes gains over 5 dB, nearest slopes by view directions 0.1 dB more."""
    sh = np.random.default_rng(0).normal(0, 0.3, (len(scene), 4, 3))
    sh[:, 0] = scene.sh[:, 0]
    strong = replace(scene, sh=sh)
    views = on_a_line(generated_camera("garden").resized(*SIZE))
    shown, seen = pictures(strong, views), directions_of(strong, views)
    found = []
    for mean, variance in ((1, 1), (1, 0), (0, 1), (0, 0)):
        each = Directions(mean * seen.mean, variance * seen.variance + (1 - variance) * np.eye(3))
        work = in_codebooks(strong, np.ones(len(scene)), each, DEFAULT, 0)
        found.append(decibels(work.packed().gaussians(), shown))
        wanted = assign_slopes(work.harmonics, strong, each)
        off = work.colour.decode().detach().numpy() - wanted
        assert off.std() < 0.04 * wanted.std()  # 0.06 with entries for the colours as they were
    assert found[0] > found[1] + 0.1 and min(found[:2]) > max(found[2:]) + 5
