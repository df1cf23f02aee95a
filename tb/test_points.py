"""Stages 0 and 1: arrays against twins on real Gaussians, twins against the reference."""

from functools import cache

import numpy as np
import pytest

from golden.points import Points, project_points
from golden.program import run
from golden.reference import covariance_and_conic, project
from model.camera_file import read_camera
from model.generate import generate, generated_camera
from model.pack import pack
from model.read import read_scene
from spec.config import DEFAULT
from spec.convention import NEAR_PLANE, SPLATCORE
from spec.microprogram import program, projection
from tb.array_ports import run_array
from tb.scenes import needs_scenes, scene_path

SCENES = {
    "flowers.spz": "flowers", "playbot.spz": "playbot", "skull.sog": "skull",
    "guitar.compressed.ply": "guitar", "luma-seal.splat": "luma-seal", "st-peter.sog": "st-peter",
    "kitchen.spz": "kitchen",
}  # fmt: skip
"""Real scenes with 20,000 Gaussians or more, and the names of their camera files."""

COUNT = 30_000
"""About as many Gaussians of each real scene are taken, evenly."""


@cache
def points(name: str) -> tuple:
    """Model, camera and twin's results of a scene's first camera."""
    if name in SCENES:
        scene = read_scene(scene_path(name))
        camera = read_camera(f"{scene_path(SCENES[name] + '.cameras.json')}:0")
    else:
        scene, camera = generate(name), generated_camera(name)
    model, _ = pack(scene[:: max(1, len(scene) // COUNT)], sh_degree=1)
    return model, camera, project_points(DEFAULT, model, camera)


def check(name: str, steps, inputs, expected):
    """An array's outputs against the twin's values, every bit."""
    found = run_array(DEFAULT, steps, inputs)
    for output, codes in found.items():
        twin = DEFAULT.arithmetic.encode(expected[output])
        wrong = np.flatnonzero(codes != twin) if len(codes) == len(twin) else [len(codes)]
        assert not len(wrong), f"{name}: {output}: {len(wrong)} differ, first {wrong[0]}"


def check_all(name: str):
    model, _, result = points(name)
    constants = result.frame.constants
    check(name, program("chunk"), constants | result.chunks, result.chunks)
    check(name, program("cull"), constants | result.culled, result.culled)
    check(name, program("place"), constants | result.placed, result.placed)
    steps = projection(model.format.sh_degree)
    check(name, steps, constants | result.projected, result.projected)


@pytest.mark.slow
def test_arrays_equal_twins_on_the_garden():
    check_all("garden")


@needs_scenes
@pytest.mark.slow
@pytest.mark.parametrize("file", SCENES)
def test_arrays_equal_twins(file):
    assert len(points(file)[2].culled["z"]) > 20_000
    check_all(file)


@pytest.mark.parametrize("degree", [0, 1])
def test_zeros_change_no_bit(degree):
    """The dense program makes what the program without the zeros makes."""
    _, _, result = points("garden")
    inputs = result.frame.constants | result.projected
    sparse = run(DEFAULT, projection(degree), inputs)
    dense = run(DEFAULT, projection(degree, skip_zeros=False), inputs)
    for name in projection(degree).outputs:
        assert (sparse[name] == dense[name]).all(), name


def largest(found: np.ndarray, exact: np.ndarray, scale: np.ndarray) -> float:
    """Largest |found − exact| / scale, in half steps of the format."""
    return float(np.max(np.abs(found - exact) / scale) / DEFAULT.arithmetic.epsilon)


def check_against_reference(name: str):
    """The bound of each output: a few roundings of 17 significant bits.

    A rounding is relative to the largest summand: to the ways to the chunk's origin and from there
    to the point, `way`, not to the point's own coordinates; and to the greatest extent that a
    Gaussian of its size may have, `spread`, not to the extent that it shows.
    """
    model, camera, result = points(name)
    gaussians, values, grid = model.gaussians(), result.projected, result.frame.constants["grid"]
    point = gaussians.position[result.index] @ camera.rotation.T + camera.translation
    depth = point[:, 2]
    start = {name: array[result.index] for name, array in result.culled.items()}
    way = sum(np.abs(start[f"from_{k}"]) + start[f"offset_{k}"] * grid for k in "xyz")
    assert largest(values["z"], depth, way) < 4
    slant = way / depth  # error of x/z and y/z grows with it
    for axis, focal, slope in ((0, camera.fx, "slope_x"), (1, camera.fy, "slope_y")):
        exact = point[:, axis] / depth * focal
        assert largest(values[slope], exact, focal * slant * (1 + np.abs(exact) / focal)) < 2
    factor = gaussians.factor[result.index]
    cov, _ = covariance_and_conic(factor, point, camera, SPLATCORE)
    sigma = np.linalg.svd(factor, compute_uv=False)[:, 0] / depth
    reach = 2 * np.log(255 * gaussians.opacity[result.index])
    full = 2 * np.log(255)
    deviations = np.sqrt(reach) + full / np.sqrt(reach)  # reach is a difference from `full`
    for row, half, focal, tangent in (
        (0, "half_width", camera.fx, camera.tan_half_fov[0]),
        (2, "half_height", camera.fy, camera.tan_half_fov[1]),
    ):
        spread = np.hypot(1, 1.3 * tangent) * focal * sigma + 1
        exact = np.sqrt(reach * cov[:, row])
        assert largest(values[half], exact, deviations * spread * slant) < 6
    assert (values["across"] > 0).all() and (values["along"] > 0).all()  # positive definite
    assert not len(np.setdiff1d(visible_indices(model, camera), result.index))


def visible_indices(model, camera) -> np.ndarray:
    """Gaussians that the reference draws, but those within an error of the near plane: none of
    them may have left.
    """
    splats, _ = project(model.gaussians(), camera)
    return splats.index[splats.depth > NEAR_PLANE * 1.001]


def test_twins_against_the_reference_on_the_garden():
    check_against_reference("garden")


@needs_scenes
@pytest.mark.slow
@pytest.mark.parametrize("file", SCENES)
def test_twins_against_the_reference(file):
    check_against_reference(file)


def test_culling_agrees_with_the_reference():
    model, camera, result = points("garden")
    depth = model.position @ camera.rotation[2] + camera.translation[2]
    certain = np.abs(depth - NEAR_PLANE) > 1e-4 * (np.abs(depth) + 10)
    kept = np.zeros(len(model), bool)
    kept[result.front] = True
    assert (kept == (depth > NEAR_PLANE))[certain].all()
    assert 0 < (~kept).sum() < len(model) and isinstance(result, Points)
