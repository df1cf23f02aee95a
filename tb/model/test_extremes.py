"""Extreme finite numbers in any field of any format: `info`, packing, reference, golden model and
cycle model render each Gaussian, or drop and count it."""

import numpy as np
import pytest

from splatcore.app.cli.describe import describe
from splatcore.golden.pipeline import render as render_golden
from splatcore.golden.reference import render
from splatcore.model.cameras.view import sensible_view
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.frame.source import Source
from splatcore.spec.config import TINY
from splatcore.spec.scene import ARRAYS, Scene
from tb.helpers.clouds import camera
from tb.helpers.floaters import EXTREME, ball, with_extremes
from tb.helpers.refusal import refused
from tb.helpers.scene_file import (
    check_bad_scene,
    compressed_ply_bytes,
    ply_bytes,
    ply_columns,
    read_written,
    sog_bytes,
    sog_codes,
    sog_meta,
    splat_bytes,
    spz_bytes,
    spz_codes,
)
from tb.helpers.scenes import random_scene

FIELDS = ("x", "f_dc_0", "f_rest_5", "opacity", "scale_1", "rot_2")

VALUES = (3.4e38, 1e30, 1e20, 1e10, 700.0, 88.0, 44.0, 1e-38, 1e-45)


def check(scene: Scene):
    """Run all engines on the scene; each Gaussian must be in the model or counted as dropped."""
    assert describe(Source("scene", scene))["gaussians"] == len(scene)
    gaussians = scene.gaussians()
    sensible_view(gaussians, 32, 24)
    frame = render(gaussians, camera(32, 24))
    assert frame.transmittance.min() >= 0
    for quality in ("faithful", "small"):
        model, report = pack(scene, TINY, quality=quality)
        assert report.packed + report.not_finite + report.transparent == len(scene)
        assert len(model) == report.packed + report.padding
        drawn = model.gaussians()
        for name in ("position", "factor", "opacity", "sh"):
            assert np.isfinite(getattr(drawn, name)).all(), name
        render(drawn, camera(32, 24))
        if 0 < np.abs(drawn.position).max(initial=0) < 1 / 512:  # the camera is too far away
            refused("512 times the scene's size", render_golden, TINY, model, camera(32, 24))
            continue
        golden = render_golden(TINY, model, camera(32, 24))
        assert frame_cycles(TINY, golden)


@pytest.mark.parametrize("count", (1, 30, 60))
@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_any_field(name, count):
    for value in EXTREME:
        check(with_extremes(ball(60), name, value, count))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_mixed():
    """Random magnitudes in all fields at once."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        scene = ball(60)
        for name in ("position", "scale", "quaternion", "sh"):
            array = getattr(scene, name)
            some = rng.uniform(size=array.shape) < 0.2
            array[some] *= 10.0 ** rng.uniform(-45, 38, int(some.sum()))
        check(scene)


@pytest.mark.parametrize("form, types", (("binary_little_endian", "float"), ("ascii", "double")))
@pytest.mark.parametrize("field", FIELDS)
def test_ply(tmp_path, field, form, types):
    columns = ply_columns(random_scene(40, 3))
    for value in (*VALUES, 1e300) if types == "double" else VALUES:
        for sign in (1, -1):
            changed = {name: column.astype(np.float64) for name, column in columns.items()}
            changed[field][::7] = sign * value
            data = ply_bytes({"vertex": changed}, form, dict.fromkeys(changed, types))
            check(read_written(tmp_path / "a.ply", data))


def test_splat(tmp_path):
    data = np.frombuffer(splat_bytes(40), np.uint8).reshape(40, 32)
    for value in (3.4e38, -3.4e38, 1e20, 1e-45):
        for place in (0, 4, 12, 20):  # x, y, scales
            changed = data.copy()
            changed[::9, place : place + 4] = np.frombuffer(np.float32(value).tobytes(), np.uint8)
            check(read_written(tmp_path / "a.splat", changed.tobytes()))


@pytest.mark.parametrize("byte", (0, 255))
@pytest.mark.parametrize("version", (1, 2, 3, 4))
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_spz(tmp_path, version, byte):
    path = tmp_path / "a.spz"
    for share, fraction in ((7, 1), (1, 24)):
        codes = spz_codes(version, 40, 2)
        for section in codes:
            section[::share] = byte
        check(read_written(path, spz_bytes(version, codes, 2, fraction)))
    for fraction in (0, 31):
        message = f"{fraction} fractional bits, not 1 … 24"
        check_bad_scene(path, spz_bytes(version, codes, 2, fraction), message)


def stretched(section: dict, low: float, high: float) -> dict:
    """A section of meta.json with `low` and `high` in its codebook or as its bounds."""
    if "codebook" in section:
        return section | {"codebook": [low, high, *section["codebook"][2:]]}
    lists = isinstance(section["mins"], list)
    mins, maxs = (
        ([low, *section["mins"][1:]], [high, *section["maxs"][1:]]) if lists else (low, high)
    )
    return section | {"mins": mins, "maxs": maxs}


@pytest.mark.parametrize("name", ("means", "scales", "sh0", "shN"))
@pytest.mark.parametrize("version", (1, 2))
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_sog(tmp_path, version, name):
    """Extreme bounds and codebooks; `tb/model/test_sog.py` has extreme labels."""
    images, meta = sog_codes(40, 1, 8), sog_meta(version, 40, 1)
    for image in images.values():
        image[0, :2, :3] = [[0], [255]]
    for low, high in ((-700, 700), (700, 700), (-700, -700), (-1e30, 1e30), (1e308, 1e308)):
        changed = meta | {name: stretched(meta[name], low, high)}
        check(read_written(tmp_path / "a.sog", sog_bytes(changed, images)))


@pytest.mark.parametrize("group", range(3))
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_compressed_ply(tmp_path, group):
    """Extreme bounds of positions, log scales or colours, on one axis or three."""
    rng = np.random.default_rng(0)
    packed = rng.integers(0, 1 << 32, (40, 4), np.uint32)
    packed[:2] = [[0], [2**32 - 1]]
    sh = rng.integers(0, 256, (40, 9), np.uint8)
    for value, axes in ((700.0, 3), (1e30, 1), (3e38, 3)):
        for signs in ((-1, 1), (1, 1), (-1, -1)):
            bounds = np.tile(np.repeat([-1.0, 1.0], 3), 3).reshape(3, 2, 3)
            bounds[group, :, :axes] = np.multiply(signs, value)[:, None]
            data = compressed_ply_bytes(bounds.reshape(1, 18), packed, sh)
            check(read_written(tmp_path / "a.ply", data))


def test_numbers_beyond_float32_are_left_out_and_counted():
    scene = ball(60)
    for name in ("position", "scale", "quaternion", "sh"):
        found = with_extremes(scene, name, 1e39, 3)
        assert pack(found)[1].not_finite == 3
    scene.position[:] = 1e39
    assert pack(scene)[1].packed == 0


def notes(name: str, value: float, count: int) -> str:
    """The notes on packing a scene in which `count` Gaussians have extreme numbers."""
    return "; ".join(pack(with_extremes(ball(60), name, value, count))[1].notes)


def test_what_is_lost_is_named():
    """The notes of the packing report name each kind of loss, with its count."""
    assert pack(ball(60))[1].notes == []
    assert notes("position", 1e30, 1).startswith("1 Gaussian far outside the scene")
    assert "moved nearer" in notes("position", 1e30, 1)
    assert "moved nearer" not in notes("position", 1e3, 1)
    assert notes("position", 1e39, 2) == "2 Gaussians with NaN, Inf or beyond float32, left out"
    assert notes("scale", 1e20, 4).startswith("4 Gaussians too large for the model")
    assert "Gaussians off by more than their size" in notes("position", 1e30, 30)
    assert "coefficients out of the range" in notes("sh", 1e30, 1)
