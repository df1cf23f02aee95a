"""Stage 3: hardware against golden model, bit for bit; golden model against reference."""

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from splatcore.golden.exact import as_packed, entries_of, features_of
from splatcore.golden.pipeline import Frame
from splatcore.golden.pipeline import render as render_golden
from splatcore.golden.raster import Entries, rasterize
from splatcore.golden.reference import project, render
from splatcore.hdl.raster.prepare import Prepare
from splatcore.hdl.raster.rasterizer import Rasterizer
from splatcore.model.formats.camera_file import read_camera
from splatcore.model.formats.read import read_scene
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.generate.hard import HARD
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.quads import quads_cycles
from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.spec.convention import COVARIANCE_BLUR
from splatcore.spec.feature import FACTOR, FACTOR_SCALE, POSITION
from splatcore.spec.frame import POWER_SCALE
from splatcore.spec.group import group_grid
from splatcore.spec.raster import curvature_formats, featured_record, readied_record
from splatcore.study.accuracy.points import with_width
from tb.helpers.bounds import RULE
from tb.helpers.configs import ALPHA, MACHINES
from tb.helpers.machines import NEEDLES, long_needles
from tb.helpers.runs import Case, compiled
from tb.helpers.scene_frames import parameters
from tb.helpers.scenes import scene_path
from tb.stages.raster import (
    Lists,
    mixed,
    nothing,
    opaque,
    opaque_features,
    prepared_codes,
    random_features,
)
from tb.stages.table import RASTERIZER, rasterizer_case

ONE, FEW, QUADS = (MACHINES[name] for name in ("SINGLE", "FEW", "QUADS"))

SCENES = ("flowers.spz", "luma-seal.splat", "playbot.spz", "skull.sog", "kitchen.spz")

SIZES = ((64, 64), (61, 35), (1, 1), (33, 2))
"""Image sizes: the largest, one that cuts blocks, and two with hardly any pixels."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "config", [DEFAULT, PAPER, with_width("8/20")], ids=lambda config: config.name
)
def test_prepare(config):
    count = 20_000
    rng = np.random.default_rng(3)
    features = random_features(config, count, (1920, 1080), seed=4)
    rest = {
        "mask": rng.integers(0, 1 << config.group**2, count).astype(np.uint64),
        "end": rng.integers(0, 2, count).astype(np.uint64),
    }
    expected = {"splat": prepared_codes(config, features)} | rest
    case = Case(
        {"i": featured_record(config).pack({"splat": features} | rest)},
        {"o": readied_record(config).pack(expected)},
    )
    case.check(compiled(Prepare, config), stall=0.2)


@pytest.mark.parametrize("bits", ["5/10", "7/12", "7/16"])
def test_nothing_is_thinner_than_the_blur(bits):
    """E's second differences keep the bound assumed in `spec.raster`, in spite of rounding."""
    config, case = with_width(bits), long_needles()
    frame = render_golden(config, pack(case.scene, config)[0], case.camera)
    codes = prepared_codes(config, frame.binned.features)
    assert len(codes["cxx"]) == NEEDLES
    for name, format in curvature_formats(config).items():
        assert np.abs(format.decode(codes[name])).max() <= 1.01 * POWER_SCALE / COVARIANCE_BLUR


@pytest.mark.slow
@pytest.mark.parametrize("stall", [0, 0.3])
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_random_tiles(size, stall):
    """Splats of all kinds, in tiles that they reach and in others."""
    for seed in range(3):
        background = ((0, 0, 0), (511, 0, 1), (100, 200, 300))[seed]
        run = mixed(TINY, 1000, size, seed, background=background).run(stall=stall, seed=seed)
        assert run.blocks > 0
        if size == (64, 64):
            assert run.golden.counts["contributions"] > 1000 and run.golden.counts["ended"] > 50


@pytest.mark.slow
@pytest.mark.parametrize("rgba", [False, True])
def test_alpha(rgba):
    """A rasterizer's blocks with alpha, of T before the next group resets it, and without."""
    lists = mixed(ALPHA, 80, (61, 35), background=(0, 0, 0) if rgba else (9, 99, 500), rgba=rgba)
    part = compiled(Rasterizer, ALPHA, RASTERIZER)
    case = rasterizer_case(lists)
    case.check(part, stall=0.3)
    if rgba:
        levels = np.bincount(lists.golden.pixels[..., 3].ravel(), minlength=256)
        assert levels[0] and levels[255] and np.count_nonzero(levels) > 100


@pytest.mark.slow
@pytest.mark.parametrize("stall", [0, pytest.param(0.3, marks=pytest.mark.verify)])
def test_quads(stall):
    """Lanes in quads: cut images, backgrounds, alpha, groups in a row with many, few and no splats
    (levels and places of the group before), and pixels that end."""
    few = {"chosen": np.tile(np.arange(4), 4)}
    runs = [
        *(mixed(QUADS, 1000, size, 1, background=(511, 0, 1)) for size in SIZES),
        mixed(QUADS, 1000, (61, 35), 2),
        mixed(QUADS, 80, (61, 35), rgba=True),
        *(mixed(QUADS, count, (64, 64), 3, background=(0, 9, 0), **few) for count in (20, 300)),
        mixed(QUADS, 20, (64, 64), 4, **few),
        opaque(QUADS, (32, 32), each=600),
        nothing(QUADS, (64, 64), background=(10, 512, 255)),
    ]
    ended = [lists.run(stall=stall, seed=3).golden.counts["ended"] for lists in runs]
    assert sum(ended) > 1000


@pytest.mark.slow
def test_levels_of_groups_before():
    """Blocks outside the image in one group, untouched in the next, alive in the third one; with
    long pauses they are output before the next group begins."""
    groups = np.tile([2, 0, 1], 8)
    for count, seed in ((20, 5), (40, 2), (40, 5)):
        mixed(QUADS, count, (72, 64), seed, chosen=groups).run(stall=0.95, seed=seed)


@pytest.mark.verify
def test_cycles_of_quads():
    """The cycle model against RTL, within 3 %."""
    lists = mixed(QUADS, 1000, (64, 64), 1)
    binned = SimpleNamespace(features=lists.features)
    frame = Frame(None, binned, None, lists.entries, lists.golden)
    assert quads_cycles(QUADS, frame) == pytest.approx(lists.run().result.cycles, rel=0.03)


@pytest.mark.verify
def test_centres_at_the_other_end():
    """Splats wider than a full-size image reach its last tiles from beyond its first ones: the
    distance from the centre needs all of its bits."""
    size, count = (1920, 1080), 16
    columns, groups = group_grid(ONE, *size)[1], int(np.prod(group_grid(ONE, *size)))
    features = opaque_features(ONE, count, size)
    for name in ("across", "along"):
        features[name][:] = FACTOR.encode(np.ldexp(1e-7, FACTOR_SCALE))
    features["opacity"][:] = np.arange(count) * 4
    features["u"][:] = POSITION.encode(np.linspace(-2047, -1000, count))
    group = np.array([columns - 1])
    start = np.where(np.arange(groups + 1) > group, count, 0)
    mask = np.full(count, (1 << ONE.group**2) - 1)
    entries = Entries(start, np.arange(count), mask)
    run = Lists(ONE, features, entries, size, chosen=group).run()
    assert run.golden.counts["contributions"] > 10 * 64**2


@pytest.mark.slow
def test_groups_without_splats():
    background = (10, 512, 255)
    run = nothing(TINY, (64, 64), background=background).run()
    assert run.blocks == 256
    full = (1 << TINY.weight) - 1  # of 2^weight
    bytes_ = [full * code / 2 ** (TINY.weight + TINY.colour_fraction - 8) for code in background]
    expected = [min(round(byte), 255) for byte in bytes_]
    assert np.unique(run.golden.pixels.reshape(-1, 3), axis=0).tolist() == [expected]


@pytest.mark.slow
def test_queues_fill_and_run_empty():
    """All queues, several times, without loss. Few splats finish blocks faster than taken."""
    size, groups = (64, 64), np.tile(np.arange(4), 4)
    full = empty = 0
    for seed, (count, stall) in enumerate(((1000, 0), (1000, 0.3), (20, 0.3), (20, 0.8))):
        background = (0, 300 * (seed & 1), 0)
        lists = mixed(TINY, count, size, seed, background=background, chosen=groups)
        run = lists.run(stall=stall, seed=seed)
        samples = run.result.samples
        pairs_full = (samples["full"] >> 1 & (1 << TINY.rasterizers) - 1) != 0
        assert (count == 1000) <= run.counters["blocked"] <= pairs_full.sum()
        full |= np.bitwise_or.reduce(samples["full"])
        empty |= np.bitwise_or.reduce(samples["empty"][1:] & ~samples["empty"][:-1])
    assert full == empty == (1 << 1 + 2 * TINY.rasterizers) - 1


@pytest.mark.slow
@pytest.mark.parametrize("config, count", [(TINY, 20), (TINY, 500), (QUADS, 500)])
def test_counters(config, count):
    """They equal the golden model's if no pixel ends (hardware learns of ends cycles later)."""
    lists = mixed(config, count, (64, 64), 7)
    lists.features["opacity"][:] = np.random.default_rng(7).integers(220, 256, count)  # faint
    run = lists.run()
    golden, counters = run.golden.counts, run.counters
    assert golden["ended"] == 0 and golden["visited"] > count
    assert counters["splats"] == count and counters["dropped"] == 0
    assert counters["pairs"] == golden["pairs"] == np.bitwise_count(lists.entries.mask).sum()
    assert counters["empty"] == golden["far"] + golden["empty"] > 0
    for number in range(config.rasterizers):
        blended = run.golden.work["visited"][:, number].sum()
        assert counters[f"blended{number}"] == blended
        assert blended < counters[f"waited{number}"] < run.result.cycles
    assert counters["blocked"] == 0


@pytest.mark.verify
def test_few_blocks():
    """If a rasterizer has few blocks, the same block may be issued again right away."""
    size = (64, 64)
    for seed, stall in enumerate((0, 0, 0.3, 0.7)):
        groups = np.tile(np.arange(16), 4)
        mixed(FEW, (40, 400)[seed & 1], size, seed, chosen=groups).run(stall=stall, seed=seed)


@pytest.mark.slow
def test_stop():
    """Once all pixels have ended, no tile is live, and later splats change nothing."""
    run = opaque(TINY, (32, 32), each=600).run()
    assert (run.result.samples["live"] == 0).any()
    assert run.golden.counts["entries"] < 10 and run.counters["dropped"] > 500


@pytest.mark.parametrize("hardware", [False, pytest.param(True, marks=pytest.mark.verify)])
def test_without_early_termination(hardware):
    """No pixel ends, and splats behind all others still contribute.

    Whole machines are tested without early termination as well (`OTHER`).
    """
    config = replace(TINY, early_termination=False, faint=())
    lists = mixed(config, 500, (64, 64), 3)
    lists.features["opacity"][:] = 0
    whole, ending = lists.golden, replace(lists, config=TINY).golden
    assert whole.counts["ended"] == 0 and ending.counts["ended"] > 100
    assert ending.counts["contributions"] < whole.counts["contributions"]
    if hardware:
        assert lists.run().counters["dropped"] == 0


def lists_of(config, splats, camera) -> Lists:
    """Return the lists of the float64 reference's splats."""
    entries = entries_of(config, splats, camera)
    return Lists(config, features_of(config, splats), entries, (camera.width, camera.height))


@functools.cache
def scene_groups(name: str):
    """Return a real scene's lists of at least 20 groups, the heaviest included."""
    gaussians = read_scene(scene_path(name)).gaussians()
    camera = read_camera(f"{scene_path(name.split('.')[0] + '.cameras.json')}:0")
    gaussians = as_packed(replace(gaussians, sh=gaussians.sh[:, :4]))
    splats, _ = project(gaussians, camera)
    lists = lists_of(ONE, splats, camera)
    order = np.argsort(np.diff(lists.entries.start))
    chosen = np.concatenate([order[-12:], order[:: len(order) // 12][:12]])
    return replace(lists, chosen=np.unique(chosen))


@pytest.mark.parametrize("name", parameters(SCENES, 2))
def test_scenes(name):
    """On one of DEFAULT's rasterizers; whole machines render with all of them."""
    lists = scene_groups(name)
    for stall in (0, 0.3):
        lists.run(stall=stall)
    assert len(lists.groups) >= 20


@pytest.mark.parametrize("name", ["garden", *HARD])
def test_against_the_reference(name):
    """The golden picture of the reference's splats, under the faintness rule, reaches 52 dB; and
    marking skips no contribution."""
    case = HARD[name](0) if name in HARD else None
    scene = case.scene if case else generate("garden", 5_000)
    camera = case.camera if case else generated_camera("garden", 320, 180)
    gaussians = as_packed(scene.gaussians())
    splats, _ = project(gaussians, camera)
    lists = lists_of(DEFAULT, splats, camera)
    arguments = (DEFAULT, lists.features, lists.entries, lists.size)
    golden, all_blocks = lists.golden, rasterize(*arguments, mark_all=True)
    assert (golden.pixels == all_blocks.pixels).all()
    assert golden.counts["contributions"] == all_blocks.counts["contributions"]
    error = golden.pixels / 255 - np.clip(render(gaussians, camera, RULE).image, 0, 1)
    assert np.mean(error**2) < 10**-5.2
