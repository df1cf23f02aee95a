"""Scenes written in every format and read back: each number within its format's step; files that
state their axes and mark; packed models as scenes; what is refused."""

import io
import json
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard

from splatcore.golden.reference import render
from splatcore.model.export import sog
from splatcore.model.export.loss import UNITS, angles, losses
from splatcore.model.export.spz import fraction_bits
from splatcore.model.export.unpacked import unpacked
from splatcore.model.export.writers import WRITERS, curve_order, find_writer, prepared
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.metric import psnr
from splatcore.spec.colour import SH_C0
from splatcore.spec.scene import Scene, rotation_matrix
from tb.helpers.clouds import camera, cloud
from tb.helpers.refusal import refused
from tb.helpers.scenes import random_scene

CASES = ((1, 0), (2, 3), (255, 1), (257, 2), (700, 3))
"""Counts of Gaussians, around a chunk's 256, and degrees."""

SLACK = 1e-5  # float32 in the readers

STEPS = {".compressed.ply": np.sqrt(2) / 1023, ".spz": np.sqrt(0.5) / 511, ".sog": np.sqrt(2) / 255}
"""Steps of a quaternion's three smallest components."""


def written(folder: Path, scene: Scene, suffix: str) -> tuple[Scene, Scene]:
    """A scene as it was written to a file in `folder`, and as it is read from it."""
    path = folder / f"scene{suffix}"
    writer = find_writer(path)
    scene, _ = prepared(scene, writer)
    writer.write(path, scene)
    return scene, read_scene(path)


def check_within(stored: np.ndarray, exact: np.ndarray, bound: np.ndarray | float):
    excess = np.abs(stored - exact) - (bound + SLACK * (1 + np.abs(exact)))
    assert (excess <= 0).all(), excess.max()


def check_rotation(stored: Scene, exact: Scene, step: float):
    """The three components other than the largest are rounded to the step."""
    sign = np.sign((stored.quaternion * exact.quaternion).sum(axis=1, keepdims=True))
    largest = np.abs(exact.quaternion).argmax(axis=1)
    others = np.arange(4) != largest[:, None]
    check_within((stored.quaternion * sign)[others], exact.quaternion[others], step / 2)
    assert (angles(stored.quaternion, exact.quaternion) < 4 * step).all()


def scene_of(count: int, degree: int) -> Scene:
    """Random Gaussians within the range of every format; some repeat, one has no rotation."""
    scene = random_scene(count, degree)
    scene.position[: count // 3] *= 30
    scene.quaternion[0] = 0
    scene.sh[count // 2 :, 0] = 0.25
    return replace(scene, antialiased=bool(degree % 2))


@pytest.mark.parametrize(("count", "degree"), CASES)
def test_ply(tmp_path, count, degree):
    scene, stored = written(tmp_path, scene_of(count, degree), ".ply")
    half = 2.0**-24
    check = np.testing.assert_allclose
    check(stored.position, scene.position, rtol=half)
    check(stored.sh, scene.sh, rtol=half)
    check(np.log(stored.scale), np.log(scene.scale), rtol=half, atol=1e-12)
    check(stored.quaternion, scene.quaternion, rtol=half)
    check(stored.opacity, scene.opacity, rtol=6 * half)
    assert stored.antialiased == scene.antialiased
    assert stored.quaternion[0].tolist() == [1, 0, 0, 0]  # no rotation


@pytest.mark.parametrize(("count", "degree"), CASES)
def test_compressed_ply(tmp_path, count, degree):
    scene, stored = written(tmp_path, scene_of(count, degree), ".compressed.ply")
    colours = (0.5 + SH_C0 * each.sh[:, 0] for each in (stored, scene))
    logs = np.log(stored.scale), np.log(scene.scale)
    for begin in range(0, count, 256):
        part = slice(begin, begin + 256)
        for (found, exact), bits in (
            ((stored.position, scene.position), (11, 10, 11)),
            (logs, (11, 10, 11)),
            (colours := tuple(colours), (8, 8, 8)),
        ):
            step = np.ptp(exact[part], axis=0) / (2.0 ** np.array(bits) - 1)
            check_within(found[part], exact[part], step / 2)
    check_within(stored.opacity, scene.opacity, 0.5 / 255)
    check_within(stored.sh[:, 1:], scene.sh[:, 1:], 1 / 64)
    check_rotation(stored, scene, STEPS[".compressed.ply"])
    assert stored.antialiased == scene.antialiased and not stored.notes


@pytest.mark.parametrize(("count", "degree"), CASES)
def test_spz(tmp_path, count, degree):
    scene, stored = written(tmp_path, scene_of(count, degree), ".spz")
    fraction = fraction_bits(scene.position, "")
    assert np.abs(stored.position - scene.position).max() <= 2.0 ** -(fraction + 1)
    assert 2**22 < np.abs(scene.position).max() * 2**fraction < 2**23 or fraction == 24
    check_within(np.log(stored.scale), np.log(scene.scale), 1 / 32)
    check_within(stored.opacity, scene.opacity, 0.5 / 255)
    check_within(stored.sh[:, 0], scene.sh[:, 0], 0.5 / 255 / 0.15)
    check_within(stored.sh[:, 1:], scene.sh[:, 1:], 1 / 256)
    check_rotation(stored, scene, STEPS[".spz"])
    assert stored.antialiased == scene.antialiased
    assert not stored.notes and not stored.assumed_axes


def test_spz_stands_in_rub_and_says_so(tmp_path):
    """The file's bytes, read by the format's description: header, record, y and z negated."""
    scene, _ = written(tmp_path, scene_of(5, 1), ".spz")
    data = (tmp_path / "scene.spz").read_bytes()
    magic, version, count, degree, fraction, flags, streams, toc = struct.unpack_from(
        "<4sIIBBBBI", data
    )
    assert (magic, version, count, degree, flags, streams) == (b"NGSP", 4, 5, 1, 3, 6)
    assert struct.unpack_from("<III", data, 32) == (0xADBE0003, 4, 4) and toc == 44  # 4: RUB
    (size, plain), at = struct.unpack_from("<QQ", data, toc), toc + 16 * streams
    position = zstandard.decompress(data[at : at + size])
    assert plain == len(position) == 9 * 5
    for k, exact in enumerate((scene.position * [1, -1, -1]).ravel()):
        fixed = int.from_bytes(position[3 * k : 3 * k + 3], "little", signed=True)
        assert fixed == round(exact * 2**fraction)


def test_spz_range(tmp_path):
    """Fractional bits follow the extent; what is beyond the range of other fields saturates."""
    for largest, bits in ((0, 23), (0.49, 24), (0.5, 23), (1 - 1e-9, 22), (300, 14), (4e6, 1)):
        position = np.array([[largest, -largest, 0]])
        assert fraction_bits(position, "") == bits
        assert np.abs(np.rint(position * 2**bits)).max() < 2**23
    refused("a.spz: a position of 5e.06 is beyond", fraction_bits, np.full((1, 3), 5e6), "a.spz")
    scene = random_scene(3, 1)
    scene.scale[0], scene.sh[1], scene.sh[2] = [0, 1e-9, 1e4], 9, -9
    _, stored = written(tmp_path, scene, ".spz")
    np.testing.assert_allclose(np.log(stored.scale[0]), [-10, -10, 5.9375], atol=1e-6)
    np.testing.assert_allclose(stored.sh[1:, 0], [[0.5 / 0.15] * 3, [-0.5 / 0.15] * 3], rtol=1e-6)
    assert np.isin(stored.sh[1:, 1:], np.outer([[1], [-1]], [1, 127 / 128])).all()  # turned or not
    assert (stored.sh[1, 1:] > 0).all() and (stored.sh[2, 1:] < 0).all()


@pytest.mark.parametrize(("count", "degree"), CASES)
def test_sog(tmp_path, count, degree):
    """Rounded to codes, or to the nearest entry of the codebook, which holds both extremes."""
    scene, stored = written(tmp_path, scene_of(count, degree), ".sog")
    archive = zipfile.ZipFile(tmp_path / "scene.sog")
    assert archive.namelist()[-1] == "meta.json"
    meta = json.loads(archive.read("meta.json"))
    found, exact = (
        np.sign(each.position) * np.log1p(np.abs(each.position)) for each in (stored, scene)
    )
    check_within(found, exact, np.ptp(exact, axis=0) / 65535 / 2)
    check_within(stored.opacity, scene.opacity, 0.5 / 255)
    check_rotation(stored, scene, STEPS[".sog"])
    fields = [("scales", np.log(stored.scale), np.log(scene.scale))]
    fields += [("sh0", stored.sh[:, 0], scene.sh[:, 0])]
    fields += [("shN", stored.sh[:, 1:], scene.sh[:, 1:])] * bool(degree)
    for name, found, exact in fields:
        book = np.array(meta[name]["codebook"])
        assert (np.diff(book) > 0).all() and len(book) <= 256
        np.testing.assert_allclose(book[[0, -1]], [exact.min(), exact.max()])
        nearest = np.abs(exact[..., None] - book).min(axis=-1)
        np.testing.assert_allclose(np.abs(found - exact), nearest, atol=1e-9)
        assert nearest.max() < max(np.ptp(book) / 50, 1e-12)
    assert stored.antialiased == scene.antialiased and not stored.notes


def test_sog_palette(tmp_path, monkeypatch):
    """More different harmonics than labels: neighbours share a row of the palette."""
    monkeypatch.setattr(sog, "PALETTE_MAX", 512)
    monkeypatch.setattr(sog, "COARSE", 16)
    scene, rng = random_scene(3000, 2), np.random.default_rng(1)
    kinds = rng.integers(0, 100, 3000)
    centres = rng.normal(0, 0.5, (100, 8, 3))
    scene.sh[:, 1:] = centres[kinds] + rng.normal(0, 1e-3, (3000, 8, 3))
    rows, labels = sog.palette(scene.sh[:, 1:].reshape(3000, -1))
    assert len(rows) <= 512 and labels.max() < len(rows)
    scene, stored = written(tmp_path, scene, ".sog")
    assert losses(scene, stored)["harmonics"]["rms"] < 0.1  # 0.5 if labels were wrong
    assert len({each.tobytes() for each in stored.sh[:, 1:]}) <= 512


def test_few_numbers_are_kept_exactly(tmp_path):
    """256 different numbers fit in a codebook, as do the colours of small packed models."""
    scene, values = random_scene(600, 1), np.random.default_rng(0).normal(size=256)
    scene.sh[:] = values[np.random.default_rng(1).integers(0, 256, scene.sh.shape)]
    scene, stored = written(tmp_path, scene, ".sog")
    assert np.array_equal(stored.sh, scene.sh)


@pytest.mark.parametrize("suffix", WRITERS)
def test_gaussians_with_nan_are_left_out(tmp_path, suffix):
    scene = random_scene(9, 1)
    scene.position[2, 1], scene.scale[4, 0], scene.sh[6, 2, 1] = np.nan, np.inf, -np.inf
    found, note = prepared(scene, WRITERS[suffix])
    assert note == "3 Gaussians with NaN or Inf left out" and len(found) == 6
    found, stored = written(tmp_path, scene, suffix)
    assert len(stored) == 6 and losses(found, stored)["position"]["largest"] < 0.01
    scene.opacity[:] = np.nan
    refused("holds no Gaussian that can be exported", prepared, scene, WRITERS[suffix])


def test_unknown_suffixes_are_refused():
    for name in ("a.splat", "a.ksplat", "ply", "a.ply.gz", "a"):
        refused(rf"^{name}: must end in \.compressed\.ply, \.ply, ", find_writer, name)
    assert find_writer("A.Compressed.PLY").name == "compressed PLY"
    assert find_writer(Path("b.ply")).name == "PLY"


def test_order_follows_a_curve():
    """The eight corners of a cube in the order of their Morton codes, x fastest."""
    corners = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)], float)
    order = np.random.default_rng(0).permutation(8)
    assert np.array_equal(corners[order][curve_order(corners[order])], corners)
    assert np.array_equal(curve_order(np.zeros((4, 3))), range(4))


@pytest.mark.parametrize("quality", ["compact", "balanced", "faithful"])
def test_a_packed_model_is_unpacked(quality):
    """The same covariances, those of needles, flat Gaussians and padding included."""
    scene = cloud(0, count=300, degree=1)
    scene.scale[:20] = [1, 1e-5, 1e-5]
    scene.scale[20:40, 2] = 0
    scene.position[-9:] *= 1e5  # floaters: padding fills the chunk before theirs
    model, report = pack(replace(scene, antialiased=True), quality=quality)
    found, exact = unpacked(model), model.gaussians()
    assert len(found) == len(model) == report.packed + report.padding and report.padding
    assert found.antialiased and np.array_equal(found.opacity, exact.opacity)
    factor = found.gaussians().factor
    covariance = factor @ factor.transpose(0, 2, 1)
    wanted = exact.factor @ exact.factor.transpose(0, 2, 1)
    size = np.abs(wanted).max(axis=(1, 2), keepdims=True)
    assert (np.abs(covariance - wanted) <= 1e-13 * size).all()
    rotation = rotation_matrix(found.quaternion)
    thin = np.linalg.norm(np.linalg.solve(rotation, exact.factor), axis=2)  # |Uᵀ·L| by rows
    np.testing.assert_allclose(thin, found.scale, atol=1e-14 * np.sqrt(size).max())
    assert np.array_equal(found.position, exact.position) and np.array_equal(found.sh, exact.sh)


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_picture_of_a_packed_garden(tmp_path, suffix):
    """The reference's picture of the file against that of the model; PLY: 60 dB and more."""
    model, _ = pack(generate("garden", 3000), quality="balanced")
    view = generated_camera("garden").resized(160, 90)
    _, stored = written(tmp_path, model, suffix)
    pictures = (render(each.gaussians(), view).pixels / 255 for each in (stored, model))
    least = {".compressed.ply": 30, ".spz": 45, ".sog": 40}.get(suffix, 60)
    db = psnr(*pictures)
    assert db is None or db >= least, db


def test_losses_are_in_their_units():
    """One error in each field, of known size."""
    scene = random_scene(4, 1)
    unit = scene.quaternion.copy()
    scene.scale[1] = 4, 1, 2
    other = replace(
        scene, position=scene.position + 0, scale=scene.scale + 0, quaternion=unit,
        opacity=scene.opacity + 0, sh=scene.sh + 0,
    )  # fmt: skip
    other.position[0] += 3, 0, 4
    other.scale[1, 1] += 0.5
    turn = np.radians(0.01) / 2
    w, x, y, z = unit[2]
    other.quaternion[2] = -(unit[2] * np.cos(turn) + np.sin(turn) * np.array([-x, w, z, -y]))
    other.opacity[3] -= 0.25
    other.sh[0, 0, 1] += 0.5
    other.sh[1, 3, 2] -= 0.75
    found = losses(scene, other)
    largest = [error["largest"] for error in found.values()]
    np.testing.assert_allclose(largest, [5, 12.5, 0.01, 0.25, 0.5, 0.75])
    rms = [5 / 2, 12.5 / np.sqrt(12), 0.01 / 2, 0.25 / 2, 0.5 / np.sqrt(12), 0.75 / 6]
    np.testing.assert_allclose([error["rms"] for error in found.values()], rms)
    assert [*found] == [*UNITS] and "harmonics" not in losses(*[scene.with_sh_degree(0)] * 2)


def test_rendering_is_that_of_the_scene(tmp_path):
    """The PLY of a scene draws its picture, marked antialiased or not."""
    for antialiased in (False, True):
        scene = replace(cloud(1, degree=3), antialiased=antialiased)
        _, stored = written(tmp_path, scene, ".ply")
        one, other = (render(each.gaussians(), camera()).image for each in (scene, stored))
        assert np.abs(one - other).max() < 1e-5


def test_images_keep_colours_where_alpha_is_0():
    from PIL import Image

    pixels = np.random.default_rng(0).integers(0, 256, (8, 8, 4), np.uint8)
    pixels[..., 3] = 0
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(sog._webp(pixels)))), pixels)
