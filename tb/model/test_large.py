"""Large scenes: packing by batches and samples."""

import tracemalloc
from dataclasses import asdict

import numpy as np
import pytest
import zstandard

from splatcore.golden.reference import render
from splatcore.model.formats import model_file
from splatcore.model.formats.model_file import FAST_LEVEL, LEVEL, decode, encode
from splatcore.model.pack import codebook
from splatcore.model.pack.codebook import quantise
from splatcore.model.pack.factor import ABOUT, about_axis, largest_axis, lower_triangular
from splatcore.model.pack.pack import clip_scales, format_of, pack
from splatcore.model.pack.stored import stored_scene
from splatcore.sim.frame.metric import psnr
from splatcore.spec import scene as scene_file
from splatcore.spec import threads
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.convention import ALPHA_MIN
from splatcore.spec.memory import CHUNK, COMPONENT, REACH, chunk_count
from splatcore.spec.scene import Scene
from tb.helpers.clouds import camera, cloud

COUNT = 4 * CHUNK + 9

MEMORY = 400
"""Bound on the bytes per Gaussian that packing takes at a time, and writing."""


def with_floaters(degree: int):
    """A scene with invisible Gaussians and three floaters, one of which is moved."""
    scene = cloud(11, count=COUNT, degree=degree)
    scene.position[[5, 500, 900], 0] = 2e3, 4e3, 1e9
    scene.opacity[[5, 500, 900]] = 0.9
    return scene


WAYS = [
    *((DEFAULT, quality) for quality in ("small", "compact", "balanced", "faithful", "mixed")),
    (PAPER, "compact"),
]
SCENES = {
    "floaters": with_floaters(3),
    "whole": cloud(12, count=2 * CHUNK),
    "none": cloud(3, count=0),
}


def mixed(scene: Scene) -> np.ndarray:
    """All layouts in turn, one per chunk."""
    return np.arange(chunk_count(len(stored_scene(scene, format_of(DEFAULT, "balanced", 3))))) % 4


@pytest.mark.parametrize("config, quality", WAYS)
@pytest.mark.parametrize("name", SCENES)
def test_batches_pack_the_same_model(name, quality, config, monkeypatch):
    scene = SCENES[name]
    quality = mixed(scene) if quality == "mixed" else quality
    found = []
    for size in (1 << 20, CHUNK, 2 * CHUNK):
        monkeypatch.setattr(scene_file, "BATCH", size)
        model, report = pack(scene, config, quality=quality)
        found.append((model.image, encode(model), asdict(report)))
        assert np.array_equal(decode(found[-1][1], "m"), model.image)
    for image, coded, report in found[1:]:
        assert np.array_equal(image, found[0][0]) and coded == found[0][1]
        assert report.pop("sh_rms") == pytest.approx(found[0][2]["sh_rms"], rel=1e-12)
        assert report.pop("colour_rms") == pytest.approx(found[0][2]["colour_rms"], rel=1e-12)
        assert report.items() <= found[0][2].items()


@pytest.mark.parametrize("quality", ["small", "compact", "balanced", "mixed"])
def test_memory_per_gaussian(quality, monkeypatch):
    """Packing and writing hold no second copy of the scene, which has 472 bytes per Gaussian."""
    monkeypatch.setattr(threads, "threads", lambda: 1)  # each further one holds batches
    monkeypatch.setattr(scene_file, "BATCH", CHUNK)
    monkeypatch.setattr(codebook, "LARGE", 0)
    monkeypatch.setattr(codebook, "SAMPLE", CHUNK)
    scene = cloud(13, count=40 * CHUNK, degree=3)
    quality = mixed(scene) if quality == "mixed" else quality
    model, _ = pack(scene, quality=quality)  # compiles

    def peak(work) -> float:
        tracemalloc.start()
        work()
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found / len(scene)

    assert peak(lambda: pack(scene, quality=quality)) < MEMORY
    assert peak(lambda: model_file.file_bytes(model)) < MEMORY


def test_sampled_codebooks_lose_little(monkeypatch):
    """Codebooks learned from a quarter of the vectors cost less than 0.05 dB."""
    scene = cloud(14, count=40_000, degree=1)
    exact, found = render(scene.gaussians(), camera(160, 120)).pixels / 255, []
    for large in (1 << 20, 1 << 14):
        monkeypatch.setattr(codebook, "LARGE", large)
        monkeypatch.setattr(codebook, "SAMPLE", large * 5 // 8)
        model, _ = pack(scene, quality="compact")
        found.append(psnr(render(model.gaussians(), camera(160, 120)).pixels / 255, exact))
    assert found[0] != found[1] > found[0] - 0.05, found


def test_sampled_codebooks_assign_the_nearest_entries(monkeypatch):
    monkeypatch.setattr(codebook, "LARGE", 1000)
    monkeypatch.setattr(codebook, "SAMPLE", 900)
    vectors = np.random.default_rng(0).normal(size=(5000, 3))
    found = quantise(vectors, (5, 4), COMPONENT)
    rest = np.ldexp(vectors, -found.exponent)
    for entries, index in zip(found.entries, found.index, strict=True):
        distance = ((rest[:, None] - entries) ** 2).sum(2)
        own = np.take_along_axis(distance, index[:, None], 1)[:, 0]
        assert (own <= distance.min(1) * (1 + 1e-4) + 1e-3).all()
        rest = rest - entries[index]


def test_columns_coded_by_samples(monkeypatch):
    """A coded file whose differences are chosen on samples, by the fast level, is read back."""
    model, _ = pack(cloud(15, count=4000, degree=3), quality="balanced")
    whole, levels, right = encode(model), [], zstandard.compress
    monkeypatch.setattr(model_file, "LARGE", 1000)
    monkeypatch.setattr(model_file, "BLOCK", 64)

    def compress(data: bytes, level: int) -> bytes:
        levels.append(level)
        return right(data, level)

    monkeypatch.setattr(zstandard, "compress", compress)
    found = encode(model)
    assert set(levels) == {LEVEL, FAST_LEVEL}
    assert np.array_equal(decode(found, "m"), model.image)
    assert len(found) < 1.1 * len(whole)
    column = np.arange(4000)
    assert 700 < len(model_file._sample(column)) <= 1000 == len(model_file._sample(column[:1000]))


@pytest.mark.parametrize("kind", ["any", "needles", "discs", "balls", "nothing"])
def test_approximate_axes(kind):
    rng = np.random.default_rng(16)
    scene = cloud(16, count=500)
    scene.scale[:] = {
        "any": np.exp(rng.normal(0, 6, (500, 3))), "needles": [1e3, 1e-4, 1e-4],
        "discs": [1, 1, 1e-4], "balls": 1 + rng.normal(0, 1e-6, (500, 3)),
        "nothing": rng.random((500, 3)) < 0.3,
    }[kind]  # fmt: skip
    lower = lower_triangular(scene.gaussians().factor)
    exact = largest_axis(lower)
    assert (np.abs(about_axis(lower) - exact) <= ABOUT * exact).all()


@pytest.mark.parametrize("kind", ["any", "alike"])
def test_reach_and_error_are_exact(kind):
    """Where the approximate axis decides which Gaussians need the exact one, nothing is lost."""
    scene = cloud(17, count=3000)
    if kind == "alike":
        scene.scale[:], scene.opacity[:] = 0.5, 0.5
    model, report = pack(scene)
    stored, _ = clip_scales(stored_scene(scene, model.format), np.inf)
    gaussians, exact = model.gaussians(), lower_triangular(stored.scene.gaussians().factor)
    axis = largest_axis(gaussians.factor)
    reach = np.sqrt(2 * np.log(np.maximum(gaussians.opacity / ALPHA_MIN, 1))) * axis
    code = REACH.encode(np.maximum.reduceat(reach, np.arange(0, len(model), CHUNK)))
    assert set(REACH.encode(model.chunks["reach"]) - code) <= {0, 1}
    error = (gaussians.factor - exact) / largest_axis(exact)[:, None, None]
    assert report.factor_error == np.abs(error).max()
