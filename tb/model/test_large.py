"""Large scenes: packing by batches and samples."""

import tracemalloc
from dataclasses import asdict, replace

import numpy as np
import pytest

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
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.memory import CHUNK, COMPONENT, REACH, chunk_count
from tb.helpers.clouds import camera, cloud

COUNT = 7 * CHUNK + 9


def with_floaters(degree: int):
    """A scene with invisible Gaussians and three floaters, one of which is moved."""
    scene = cloud(11, count=COUNT, degree=degree)
    scene.position[[5, 500, 900], 0] = 2e3, 4e3, 1e9
    scene.opacity[[5, 500, 900]] = 0.9
    return scene


@pytest.mark.parametrize("config", [DEFAULT, PAPER], ids=lambda config: config.name)
@pytest.mark.parametrize("quality", ["small", "compact", "balanced", "faithful", "mixed"])
@pytest.mark.parametrize("scene", [with_floaters(3), cloud(12, count=2 * CHUNK), cloud(3, count=0)])
def test_batches_pack_the_same_model(scene, quality, config, monkeypatch):
    if config is PAPER and quality != "compact":
        pytest.skip("not a quality of PAPER")
    if quality == "mixed":
        quality = np.arange(chunk_count(len(scene)) + 1) % 4
        quality = quality[: chunk_count(len(stored_scene(scene, format_of(config, "balanced", 3))))]
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


def test_memory_per_gaussian(monkeypatch):
    """Packing holds no second copy of the scene: its peak per Gaussian is bounded."""
    monkeypatch.setattr(scene_file, "BATCH", CHUNK)
    scene = cloud(13, count=80 * CHUNK, degree=3)
    quality = np.full(chunk_count(len(scene)), 2)
    quality = quality[: chunk_count(len(stored_scene(scene, format_of(DEFAULT, "balanced", 3))))]
    for chosen, bound in (("balanced", 300), (quality, 300)):
        pack(scene, quality=chosen)  # compiles
        tracemalloc.start()
        model, _ = pack(scene, quality=chosen)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < bound * len(scene), peak / len(scene)
        tracemalloc.start()
        model_file.file_bytes(model)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 250 * len(scene), peak / len(scene)
