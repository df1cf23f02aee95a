"""Floaters are packed into chunks of their own: none is lost, and other scenes keep their bytes."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden.pipeline import render as render_golden
from splatcore.golden.reference import render
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import GENERATORS, generate
from splatcore.model.pack.chunk import chunk_positions
from splatcore.model.pack.floaters import FAR, GAP, RESERVE_BITS, SHARE, find_floaters
from splatcore.model.pack.pack import MEDIAN_BITS, pack
from splatcore.model.pack.quality import QUALITIES
from splatcore.model.pack.stored import keep, stored_scene
from splatcore.sim.frame.metric import psnr
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.memory import CHUNK, step_format
from splatcore.spec.scene import Scene
from tb.helpers.clouds import camera
from tb.helpers.floaters import ball, strewn
from tb.helpers.scenes import GAUSSIANS, REAL, scene_path

FORMAT = step_format(DEFAULT, 3)

COST_MAX = 0.5  # dB that floaters may cost the rest of the scene
ENOUGH = 70.0  # dB; above it the steps of the floaters' own offsets dominate

CHECKSUMS = {
    "garden": 493263259,
    "depth_range": 3321013318,
    "whole_screen": 4284415106,
    "leica-sofort-top8192.ply": 284906373,
    "luma-seal.splat": 1331454711,
}
"""Checksums of faithful models without floaters, which the rule for floaters must not change."""


def packing_db(scene: Scene, **options) -> float:
    """PSNR in dB of the packed model against the scene, both by the reference renderer."""
    view = camera(320, 180)
    pair = (g.gaussians() for g in (pack(scene, **options)[0], scene))
    a, b = (render(gaussians, view).pixels / 255 for gaussians in pair)
    found = psnr(a, b)
    return 200.0 if found is None else found


@pytest.mark.parametrize("axes", (1, 3))
@pytest.mark.parametrize("distance", (6.0, 30.0, 1e4, 1e6, 2.1e7, 1e15, 3e38))
@pytest.mark.parametrize("floaters, count", ((1, 199), (1, 2000), (2, 2000), (20, 2000)))
def test_floaters_cost_next_to_nothing(floaters, count, distance, axes):
    """A scene with floaters packs as well as without them, within COST_MAX."""
    scene = strewn(ball(count + floaters), floaters, distance, axes)
    near = np.abs(scene.position).max(1) <= 1
    least = packing_db(scene[near], quality="faithful") - COST_MAX
    assert packing_db(scene, quality="faithful") >= min(least, ENOUGH)


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("count", (40, 255, 256, 257, 511, 512, 1000))
def test_nothing_is_lost_and_chunks_are_full(count, quality):
    """Each Gaussian is stored once; padding only fills the last chunk before the floaters."""
    scene = strewn(ball(count + 2), 2, 1e3, 3)
    model, report = pack(scene, quality=quality)
    stored = stored_scene(scene, model.format)
    own = ~stored.chunks.padding
    assert (np.sort(stored.index[own]) == np.arange(count + 2)).all()
    assert report.packed == report.gaussians == count + 2 and report.floaters == 2
    assert report.padding == -count % CHUNK == (~own).sum() < CHUNK
    assert len(model) == len(own) == report.packed + report.padding
    assert own[-2:].all() and (np.abs(scene.position[stored.index[-2:]]).max(1) > 10).all()
    filling = model.gaussians()[~own]
    assert (filling.factor == 0).all() and (
        filling.opacity < (1.1 if quality != "small" else 1.2) / 255
    ).all()
    original = model.gaussians()[own]
    exact = stored.scene[own]
    steps = np.abs(original.position - exact.position).max(1)
    assert np.sort(steps)[:-2].max() <= 2.0 ** (-15 if quality != "small" else -9)


def test_padding_is_hardly_seen():
    """Padding changes no pixel by as much as an 8-bit code, and almost no pixel at all."""
    scene = strewn(ball(700), 1, 1e6, 3)
    model, _ = pack(scene, quality="faithful")
    own = ~stored_scene(scene, model.format).chunks.padding
    view = camera(320, 180)
    a, b = (render(g, view).image for g in (model.gaussians(), model.gaussians()[own]))
    assert 0 <= np.abs(a - b).max() < 1 / 255
    assert np.mean((a != b).any(2)) < 0.001
    marked = replace(scene, antialiased=True)
    model, _ = pack(marked, quality="faithful")
    a, b = (render(g, view).image for g in (model.gaussians(), model.gaussians()[own]))
    assert (a == b).all(), "compensation removes splats without area"


def test_floaters_leave_the_grid_as_fine_as_float32():
    """The floater moves nearer along its direction, so that it does not coarsen the grid."""
    scene = ball(600)
    position = scene.position.copy()
    position[7] = 1e30, -1e30, 3
    floaters = find_floaters(position)
    assert list(floaters.index) == [7]
    position[7] = floaters.position[0]
    chunks = chunk_positions(position, floaters=floaters.index)
    assert np.ldexp(1.0, chunks.exponent) <= np.abs(scene.position).max() * 2.0**-23
    far = np.abs(floaters.position).max()
    assert 2.0 ** (RESERVE_BITS - 1) <= far <= 2.0**RESERVE_BITS
    way = floaters.position[0] / floaters.position[0, 0]
    np.testing.assert_allclose(way, (1, -1, 0), atol=1e-3)


def test_a_floater_brought_nearer_looks_the_same():
    """A camera within the scene sees the moved floater where, and as large as, it was."""
    scene = ball(600)
    position, scale = scene.position.copy(), scene.scale.copy()
    position[7], scale[7] = (1e8, -2e8, 1e9), 2e7
    scene = replace(scene, position=position, scale=scale)
    model, report = pack(scene, quality="faithful")
    assert (report.floaters, report.moved, report.clipped) == (1, 1, 0)
    far = np.abs(model.position).max(1) > 100
    seen = [g.gaussians()[m] for g, m in ((model, far), (scene, [7]))]
    a, b = (render(g, camera(320, 180)).image for g in seen)
    assert b.max() > 0.1 and np.abs(a - b).max() < 0.03


def test_far_floaters_leave_near_ones_in_place():
    """They share a chunk, yet a camera in the scene sees the near one shift by under 1/256 rad."""
    position = ball(600).position
    position[7], position[8] = (0.123, 0.777, 6.111), (1e12, -1e12, -1e12)
    scene = replace(ball(600), position=position)
    model, report = pack(scene, quality="faithful")
    assert (report.floaters, report.moved) == (2, 1)
    near, far = model.gaussians().position[-2:]
    if np.abs(near).max() > np.abs(far).max():
        near, far = far, near
    assert np.abs(near - position[7]).max() / 6.111 < 1 / 256
    assert np.abs(far).max() > 256


def test_the_edges_of_the_rule():
    """find_floaters just inside and outside its limits: GAP, SHARE, FAR, tiny scenes."""
    rng = np.random.default_rng(0)
    position = rng.uniform(-1, 1, (640, 3))
    position[0] = 0.999
    most = np.abs(position - np.median(position, axis=0)).max()
    for factor, found in ((0.97, 0), (1.05, 1)):
        position[1] = np.median(position, axis=0)
        position[1, 0] += most * GAP * factor
        assert len(find_floaters(position).index) == found, factor
    for count, found in ((640 // SHARE, 640 // SHARE), (640 // SHARE + 1, 0)):
        position[:count, 2] = 1000.0
        assert len(find_floaters(position).index) == found, count
    for count in (0, 1, 2, 15):
        assert not len(find_floaters(rng.normal(size=(count, 3)) * 1e30).index)
    chain = rng.uniform(-1, 1, (3200, 3))
    chain[:100, 0] = 1.5 ** np.arange(100)  # no gap
    found = find_floaters(chain).index
    assert chain[found, 0].min() > FAR * 0.9 and len(found) > 80
    assert (np.diff(np.abs(find_floaters(chain).position[:, 0])) >= -1e-9).all()


@pytest.mark.parametrize("name", GENERATORS)
def test_generated_scenes_have_none(name):
    scene = generate(name)
    stored = stored_scene(scene, FORMAT)
    assert not stored.floaters and not stored.chunks.padding.any()
    if name in CHECKSUMS:
        assert pack(scene, quality="faithful")[0].value("checksum") == CHECKSUMS[name]


@pytest.mark.parametrize("name", [pytest.param(name, marks=REAL) for name in GAUSSIANS])
def test_real_scenes_have_none(name):
    scene = read_scene(scene_path(name))
    finite, visible = keep(scene)
    assert not len(find_floaters(scene.position[finite & visible]).index)
    if name in CHECKSUMS:
        assert pack(scene, quality="faithful")[0].value("checksum") == CHECKSUMS[name]


def test_large_gaussians_are_clipped_so_that_others_keep_their_shape():
    scene = ball(300)
    without = pack(scene, quality="faithful")[0].gaussians()
    scale = scene.scale.copy()
    for size, clipped in ((1e3, 0), (1e19, 1), (3e38, 1)):
        scale[5] = size
        model, report = pack(replace(scene, scale=scale), quality="faithful")
        assert report.clipped == clipped
        shape = np.linalg.norm(model.gaussians().factor, axis=(1, 2))
        kept = shape < 1
        assert kept.sum() == 299
        exact = np.sort(np.linalg.norm(without.factor, axis=(1, 2)))
        assert np.median(shape) == pytest.approx(np.median(exact), rel=0.02)
        assert shape[kept].min() == pytest.approx(exact[0], rel=0.05)
        assert shape.max() <= np.median(scene.scale.max(1)) * 2.0 ** (17 + MEDIAN_BITS) * 2


def test_absolute_positions_take_floaters_within_their_floats():
    """PAPER stores absolute FP16 positions: floaters move into their range and stay finite."""
    scene = strewn(ball(600), 2, 1e9, 3)
    model, report = pack(scene, PAPER)
    assert report.moved == 2 and np.isfinite(model.position).all()
    assert np.sort(np.abs(model.position).max(1))[-2] > 1e3


def test_golden_and_reference_agree_on_floaters():
    scene = strewn(ball(700), 5, 1e5, 3)
    model, _ = pack(scene, quality="faithful")
    view = camera(96, 64)
    exact = render(model.gaussians(), view).pixels / 255
    assert psnr(render_golden(DEFAULT, model, view).pixels / 255, exact) > 55
