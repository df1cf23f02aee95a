"""Files are read in batches: the same scene for any batch, and little memory next to the scene;
harmonics in float32 give the same bits as in float64."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from splatcore.app.cli.describe import describe
from splatcore.golden.reference import render
from splatcore.model.compress.prune import replaced
from splatcore.model.export import sog, spz
from splatcore.model.export.loss import losses
from splatcore.model.formats import file, gltf_write, ply
from splatcore.model.formats.read import LOOKS, read_scene
from splatcore.model.generate.generate import garden
from splatcore.model.pack.pack import pack
from splatcore.sim.frame.budget import part_by_part
from splatcore.sim.frame.source import Source
from splatcore.spec import scene as scenes
from splatcore.spec import threads
from splatcore.spec.colour import folded
from splatcore.spec.scene import ARRAYS, Scene, joined, rotation_matrix
from tb.helpers.clouds import camera, cloud
from tb.helpers.gltf_file import glb_of
from tb.helpers.ksplat_file import small_ksplat
from tb.helpers.scene_file import (
    compressed_ply_bytes,
    ply_bytes,
    ply_columns,
    sog_bytes,
    sog_codes,
    sog_meta,
    splat_bytes,
    spz_bytes,
    spz_codes,
)
from tb.helpers.scenes import random_scene

COUNT = 700
"""Gaussians of a file: two batches of `SMALL` and a part of one."""

SMALL = 256  # a multiple of the chunks of a compressed PLY


def odd(count: int, degree: int) -> Scene:
    """A scene with every kind of unusual Gaussian, in the last batch, too."""
    scene = random_scene(count, degree)
    scene.position[[5, count - 1], 1] = np.nan
    scene.quaternion[[7, count - 2]] = 0
    scene.quaternion[[8, count - 3]] *= 1e5
    scene.sh[[9, count - 4], 0] = 40
    return scene


def plain(degree: int, **options) -> Callable[[int], bytes]:
    return lambda count: ply_bytes({"vertex": ply_columns(odd(count, degree))}, **options)


def coloured(count: int) -> bytes:
    columns = ply_columns(random_scene(count, 0))
    for channel, name in enumerate(("red", "green", "blue")):
        columns[name] = np.arange(count) * (channel + 1) % 256
        del columns[f"f_dc_{channel}"]
    return ply_bytes({"vertex": columns}, types=dict.fromkeys(("red", "green", "blue"), "uchar"))


def compressed(count: int) -> bytes:
    rng = np.random.default_rng(0)
    bounds = rng.normal(size=(-(-count // 256), 18)).astype(np.float32)
    sh = rng.integers(0, 256, (count, 24), np.uint8)
    return compressed_ply_bytes(bounds, rng.integers(0, 1 << 32, (count, 4), np.uint32), sh)


def in_images(version: int) -> Callable[[int], bytes]:
    def write(count: int) -> bytes:
        return sog_bytes(sog_meta(version, count, 2), sog_codes(count, 2, 25))

    return write


FILES = {
    "plain.ply": plain(3),
    "mixed.ply": plain(1, types={"x": "double"}),
    "double.ply": plain(2, types={"f_rest_3": "double"}),
    "big.ply": plain(3, form="binary_big_endian"),
    "ascii.ply": plain(1, form="ascii"),
    "coloured.ply": coloured,
    "compressed.ply": compressed,
    "half.spz": lambda count: spz_bytes(1, spz_codes(1, count, 3), 3),
    "three.spz": lambda count: spz_bytes(3, spz_codes(3, count, 2), 2),
    "four.spz": lambda count: spz_bytes(4, spz_codes(4, count, 3), 3),
    "turned.glb": lambda count: glb_of(random_scene(count, 3)),
    "one.sog": in_images(1),
    "two.sog": in_images(2),
    "a.splat": splat_bytes,
    "whole.ksplat": lambda count: small_ksplat(0, 2, count),
    "half.ksplat": lambda count: small_ksplat(1, 1, count),
    "small.ksplat": lambda count: small_ksplat(2, 2, count),
}
"""A name of each layout → the bytes of its file."""


@pytest.mark.parametrize("name", FILES)
def test_batches_read_as_one(tmp_path, monkeypatch, name):
    """Arrays, their types and notes are the same for batches of 256 as for one."""
    path = tmp_path / name
    path.write_bytes(FILES[name](COUNT))
    whole = read_scene(path)
    facts = describe(Source(name, whole))
    monkeypatch.setattr(scenes, "BATCH", SMALL)
    parts = read_scene(path)
    for field in ARRAYS:
        one, other = getattr(whole, field), getattr(parts, field)
        assert one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True), field
        assert one.flags.c_contiguous and other.flags.c_contiguous, field
    assert (len(parts), parts.notes, parts.name) == (COUNT, whole.notes, whole.name)
    assert repr(describe(Source(name, parts))) == repr(facts)
    factor = parts.gaussians().factor
    assert np.array_equal(factor, rotation_matrix(parts.quaternion) * parts.scale[:, None], True)


@pytest.mark.parametrize("name", FILES)
def test_float32_harmonics(tmp_path, name):
    """Harmonics are float32 where the file has no others."""
    path = tmp_path / name
    path.write_bytes(FILES[name](40))
    others = "double.ply", "coloured.ply", "one.sog", "two.sog", "a.splat"
    kind = np.float64 if name in others or name.endswith(".ksplat") else np.float32
    scene = read_scene(path)
    assert scene.sh.dtype == kind
    assert {getattr(scene, field).dtype for field in ARRAYS[:4]} == {np.dtype(np.float64)}


def peak(work: Callable[[], object]) -> tuple[int, object]:
    """Most bytes allocated during a call, and its result."""
    work()  # compiles and imports
    tracemalloc.start()
    try:
        found = work()
        return tracemalloc.get_traced_memory()[1], found
    finally:
        tracemalloc.stop()


ABOVE = {
    "plain.ply": 0,
    "compressed.ply": 0,
    "four.spz": 65,  # the unpacked sections
    "turned.glb": 40,  # scales and opacities are checked as a whole
    "two.sog": 60,  # the images
    "small.ksplat": 75,  # the file
}
"""Bytes per Gaussian that reading may take in addition to the scene and to the batch."""

MANY = 100 * SMALL


@pytest.mark.parametrize("name", ABOVE)
def test_memory_of_reading(tmp_path, monkeypatch, name):
    monkeypatch.setattr(threads, "threads", lambda: 1)  # each further one holds batches
    monkeypatch.setattr(scenes, "BATCH", SMALL)
    path = tmp_path / name
    path.write_bytes(FILES[name](MANY))
    taken, scene = peak(lambda: read_scene(path))
    held = sum(getattr(scene, field).nbytes for field in ARRAYS)
    batch = SMALL * (6 * held / MANY + 24 * LOOKS)  # bright ones are looked at from all sides
    assert held <= taken < held + ABOVE[name] * MANY + batch + 100_000


def test_memory_of_info(tmp_path, monkeypatch):
    """The percentiles of scales take a copy of them; the rest is as long as a batch."""
    monkeypatch.setattr(scenes, "BATCH", SMALL)
    source = Source("random", random_scene(MANY, 3))
    assert peak(lambda: describe(source))[0] < 48 * MANY + 100_000


def test_memory_of_the_garden(monkeypatch):
    """Generating takes at most the scene and the unlit splats, 169 bytes each, twice."""
    monkeypatch.setattr(scenes, "BATCH", SMALL)
    taken, scene = peak(lambda: garden(30_000, sh_degree=3))
    held = sum(getattr(scene, field).nbytes for field in ARRAYS)
    assert taken < held + 2 * 169 * len(scene)


def test_written_in_batches(tmp_path, monkeypatch):
    scene = random_scene(COUNT, 3)
    ply.write_ply(tmp_path / "whole.ply", scene)
    monkeypatch.setattr(scenes, "BATCH", SMALL)
    taken, _ = peak(lambda: ply.write_ply(tmp_path / "parts.ply", scene))
    assert (tmp_path / "parts.ply").read_bytes() == (tmp_path / "whole.ply").read_bytes()
    large = random_scene(MANY, 3)
    taken, _ = peak(lambda: ply.write_ply(tmp_path / "large.ply", large))
    assert taken < 236 * MANY / 2


def test_joined():
    """Harmonics that a scene lacks are 0; float32 stays only among float32."""
    one, two = in_float32(random_scene(4, 1)), random_scene(3, 2, seed=1)
    both = joined([one, two])
    assert both.sh.dtype == np.float64 and joined([one, one]).sh.dtype == np.float32
    assert np.array_equal(both.sh[:4, :4], one.sh) and not both.sh[:4, 4:].any()
    assert np.array_equal(both.sh[4:], two.sh) and joined([two]) is two
    assert np.array_equal(both.scale, np.concatenate([one.scale, two.scale]))


def in_float32(scene: Scene) -> Scene:
    return replace(scene, sh=scene.sh.astype(np.float32))


def twins(degree: int) -> tuple[Scene, Scene]:
    """A scene with harmonics in float32, and with the same numbers in float64."""
    narrow = in_float32(cloud(1, 600, degree))
    return narrow, replace(narrow, sh=narrow.sh.astype(np.float64))


@pytest.mark.parametrize("degree, quality", [(1, "compact"), (3, "balanced"), (3, "faithful")])
def test_float32_gives_the_same_bits(tmp_path, degree, quality):
    """Models, pictures, exported files and their losses do not depend on the type of `sh`."""
    narrow, wide = twins(degree)
    models = [pack(each, quality=quality)[0] for each in (narrow, wide)]
    assert np.array_equal(models[0].image, models[1].image)
    images = [render(each.gaussians(), camera()).image for each in (narrow, wide)]
    assert np.array_equal(*images)
    for of_one, of_other in zip(
        *(part_by_part(each, models[0]) for each in (narrow, wide)), strict=True
    ):
        assert np.array_equal(of_one[1].sh, of_other[1].sh)
    writers = {
        "a.ply": ply.write_ply,
        "a.compressed.ply": ply.write_compressed_ply,
        "a.glb": gltf_write.write_glb,
        "a.spz": spz.write,
        "a.sog": sog.write,
    }
    for name, write in writers.items():
        data = []
        for each in (narrow, wide):
            write(tmp_path / name, each)
            data.append((tmp_path / name).read_bytes())
        assert name == "a.sog" or data[0] == data[1], name  # a zip has the time
        stored = read_scene(tmp_path / name)
        assert losses(narrow, stored) == losses(wide, stored), name


def test_float32_is_widened_before_computing():
    """Factors for packing, and a scene in which merged Gaussians replace others."""
    narrow, wide = twins(3)
    for one, other in zip(folded(narrow.sh), folded(wide.sh), strict=True):
        assert one.dtype == np.float64 and np.array_equal(one, other)
    merged = replace(wide[:2], sh=wide.sh[:2] / 3)
    index = np.array([4, 7])
    both = [replaced(each, index, merged).sh for each in (narrow, wide)]
    assert np.array_equal(*both) and np.array_equal(both[0][index], merged.sh)


def test_batches_cover_all_rows(monkeypatch):
    monkeypatch.setattr(scenes, "BATCH", 4)
    for count in (1, 3, 4, 5, 8, 9):
        rows = np.concatenate([np.arange(count)[each] for each in scenes.batches(count)])
        assert np.array_equal(rows, np.arange(count))
    assert file.in_batches(3, lambda rows: random_scene(9, 1)[rows]).sh_degree == 1
