"""The sixteen axis systems of SPZ, converted to PLY's, against oracles independent of the reader.

The oracle converts directions, positions and covariances by the letters of a system's name; colours
come from scipy's Legendre functions. Expected pictures are the reference's of the converted PLY.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from splatcore.golden.reference import render
from splatcore.model.formats.ply import write_ply
from splatcore.model.formats.read import read_scene
from splatcore.model.formats.spz_axes import AXES, PLY_AXES, SPZ_AXES, turned
from splatcore.spec.camera import look_at
from splatcore.spec.scene import Scene
from tb.helpers.harmonics import harmonics
from tb.helpers.scene_file import spz_of
from tb.helpers.scenes import random_scene

NUMBERS = {
    1: "LDB", 2: "RDB", 3: "LUB", 4: "RUB", 5: "LDF", 6: "RDF", 7: "LUF", 8: "RUF",
    9: "LFD", 10: "RFD", 11: "LFU", 12: "RFU", 13: "LBD", 14: "RBD", 15: "LBU", 16: "RBU",
}  # fmt: skip
"""Numbers of the systems in a file's record, from `splat-types.h` of nianticlabs/spz."""

MIRRORED = "RDB LUB LDF RUF RFD LFU LBD RBU".split()

DIRECTIONS = {"R": "+x", "L": "-x", "D": "+y", "U": "-y", "F": "+z", "B": "-z"}


def by_letters(points: np.ndarray, axes: str) -> np.ndarray:
    """Convert points [N, 3] from `axes` to PLY's axes: right, down, front."""
    found = np.zeros_like(points)
    for column, letter in zip(points.T, axes, strict=True):
        sign, name = DIRECTIONS[letter]
        found[:, "xyz".index(name)] += column if sign == "+" else -column
    return found


def test_names_and_numbers():
    assert dict(enumerate(AXES, 1)) == NUMBERS
    assert (PLY_AXES, SPZ_AXES) == ("RDF", "RUB")
    for axes in AXES:
        mirrored = np.linalg.det(by_letters(np.eye(3), axes)) < 0
        assert mirrored == (axes in MIRRORED)


@pytest.mark.parametrize("axes", AXES)
@pytest.mark.parametrize("degree", range(4))
def test_turned(axes, degree):
    """Positions, covariances, and colours along converted directions equal the oracle's."""
    scene = random_scene(100, degree)
    found = turned(scene, axes)
    assert np.array_equal(found.position, by_letters(scene.position, axes))
    theirs = np.stack([by_letters(f.T, axes).T for f in scene.gaussians().factor])
    ours = found.gaussians().factor
    error = ours @ ours.transpose(0, 2, 1) - theirs @ theirs.transpose(0, 2, 1)
    assert np.abs(error).max() < 1e-14
    direction = np.random.default_rng(degree).normal(size=(40, 3))
    before = np.einsum("dk,nkc", harmonics(direction, degree), scene.sh)
    after = np.einsum("dk,nkc", harmonics(by_letters(direction, axes), degree), found.sh)
    assert np.abs(before - after).max() < 1e-13
    assert np.array_equal(found.opacity, scene.opacity)


def stored(scene: Scene, axes: str) -> Scene:
    """Convert a scene from PLY's axes to `axes` by dense algebra alone: the inverse of the oracle,
    with harmonics fitted to colours."""
    inverse = by_letters(np.eye(3), axes)  # rows: direction of each axis, so p @ inverse.T
    mirror = np.linalg.det(inverse)
    factor = inverse @ scene.gaussians().factor * mirror  # mirrored axes: −1 changes no covariance
    direction = np.random.default_rng(1).normal(size=(200, 3))
    basis = harmonics(direction @ inverse.T, scene.sh_degree)
    colour = np.einsum("dk,nkc->dnc", harmonics(direction, scene.sh_degree), scene.sh)
    sh = np.linalg.lstsq(basis, colour.reshape(len(direction), -1))[0]
    sh = sh.reshape(basis.shape[1], len(scene), 3).transpose(1, 0, 2)
    rotation = factor / scene.scale[:, None, :]
    quaternion = Rotation.from_matrix(rotation).as_quat()[:, [3, 0, 1, 2]]
    return replace(scene, position=scene.position @ inverse.T, quaternion=quaternion, sh=sh)


def decibels(one: np.ndarray, other: np.ndarray) -> float:
    return -10 * np.log10(np.mean((one - other) ** 2) + 1e-30)


@pytest.mark.parametrize("number, axes", NUMBERS.items())
@pytest.mark.parametrize("degree", range(4))
def test_picture_of_the_turned_ply(tmp_path, number, axes, degree):
    """A file in any system renders like the PLY, within the format's rounding; read as RUB it does
    not. A file without a record renders the same with --axes."""
    scene = random_scene(60, degree, seed=number)
    scene = replace(scene, scale=np.clip(scene.scale, 0.02, 0.3))
    write_ply(tmp_path / "turned.ply", scene)
    camera = look_at(np.array([0.5, -1.0, -7.0]), np.zeros(3), 96, 72, 90.0)
    right = render(read_scene(tmp_path / "turned.ply").gaussians(), camera).image
    rdf = read_picture(tmp_path, spz_of(scene, 6), camera)
    numbers = stored(scene, axes)
    found = read_picture(tmp_path, spz_of(numbers, number), camera)
    # The format's rounding alone leaves 32 to 45 dB in PLY's own axes.
    assert decibels(found, right) > min(decibels(rdf, right) - 3, 40)
    without = read_picture(tmp_path, spz_of(numbers, None), camera, axes)
    assert np.array_equal(without, found)
    if axes != "RUB":
        assert decibels(read_picture(tmp_path, spz_of(numbers, None), camera), right) < 26


def read_picture(tmp_path, data: bytes, camera, axes: str | None = None) -> np.ndarray:
    (tmp_path / "scene.spz").write_bytes(data)
    return render(read_scene(tmp_path / "scene.spz", axes).gaussians(), camera).image
