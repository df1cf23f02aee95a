"""Stage 3: hardware against twin, bit for bit, and the twin against the reference."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from golden.exact import Entries, as_packed, entries_of, features_of
from golden.raster import rasterize
from golden.reference import project, render
from hdl.prepare import Prepare
from hdl.raster import Raster
from model.camera_file import read_camera
from model.generate import generate, generated_camera
from model.hard import HARD
from model.read import read_scene
from sim.streams import Simulation
from spec.config import DEFAULT, PAPER, TINY
from spec.group import group_grid
from spec.raster import featured_record, readied_record
from tb.raster_rows import prepared_codes, run_groups
from tb.scenes import needs_scenes, scene_path
from tb.splat_features import random_features

SCENES = ("flowers.spz", "playbot.spz", "skull.sog", "kitchen.spz", "luma-seal.splat")


@functools.cache
def simulation(config) -> Simulation:
    return Simulation(Raster(config), samples=("stop",))


def random_entries(config, count: int, size: tuple[int, int], seed: int) -> Entries:
    """Lists with tiles drawn at random, whether a splat reaches them or not."""
    rng = np.random.default_rng(seed)
    groups = int(np.prod(group_grid(config, *size)))
    lengths = rng.multinomial(count, np.full(groups, 1 / groups))
    start = np.concatenate([[0], np.cumsum(lengths)])
    mask = rng.integers(1, 1 << config.group**2, count)
    return Entries(start, rng.integers(0, count, count), mask)


@pytest.mark.slow
@pytest.mark.parametrize("config", [DEFAULT, PAPER], ids=lambda config: config.name)
def test_prepare(config):
    count = 20_000
    rng = np.random.default_rng(3)
    features = random_features(config, count, (1920, 1080), seed=4)
    rest = {
        "mask": rng.integers(0, 1 << config.group**2, count).astype(np.uint64),
        "end": rng.integers(0, 2, count).astype(np.uint64),
    }
    result = Simulation(Prepare(config)).run(
        {"i": featured_record(config).pack({"splat": features} | rest)},
        expected={"o": count}, stall=0.2,
    )  # fmt: skip
    expected = {"splat": prepared_codes(config, features)} | rest
    found = readied_record(config).unpack(result.outputs["o"])
    for name, codes in expected["splat"].items():
        assert (found["splat"][name] == codes).all(), name
    assert (result.outputs["o"] == readied_record(config).pack(expected)).all()


@pytest.mark.slow
@pytest.mark.parametrize("stall", [0, 0.3])
@pytest.mark.parametrize("size", [(64, 64), (61, 35), (1, 1), (33, 2)], ids=str)
def test_random_tiles(size, stall):
    """Splats of all kinds, tiles that they reach and tiles that they do not."""
    for seed in range(3):
        features = random_features(TINY, 1000, size, seed)
        entries = random_entries(TINY, 1000, size, seed)
        background = ((0, 0, 0), (511, 0, 1), (100, 200, 300))[seed]
        run = run_groups(
            simulation(TINY), TINY, features, entries, size, background=background,
            stall=stall, seed=seed,
        )  # fmt: skip
        assert run.differing == 0 and run.blocks > 0
        if size == (64, 64):
            assert run.twin.counts["contributions"] > 1000 and run.twin.counts["ended"] > 50


@pytest.mark.slow
def test_groups_without_splats():
    features = random_features(TINY, 4, (64, 64), 0)
    groups = int(np.prod(group_grid(TINY, 64, 64)))
    nothing = Entries(np.zeros(groups + 1, int), np.zeros(0, int), np.zeros(0, int))
    background = (10, 512, 255)
    run = run_groups(simulation(TINY), TINY, features, nothing, (64, 64), background=background)
    assert run.differing == 0 and run.blocks == 256
    full = (1 << TINY.weight) - 1  # of 2^weight
    bytes_ = [full * code / 2 ** (TINY.weight + TINY.colour_fraction - 8) for code in background]
    expected = [min(round(byte), 255) for byte in bytes_]
    assert np.unique(run.twin.pixels.reshape(-1, 3), axis=0).tolist() == [expected]


@pytest.mark.slow
def test_stop():
    """It is raised once all pixels have ended, and what comes then changes nothing."""
    size = (32, 32)
    features = random_features(TINY, 600, size, 5)
    features["opacity"][:] = 0
    for name in ("across", "along"):
        features[name][:] = TINY.arithmetic.encode(1e-6)
    features["half_width"][:] = features["half_height"][:] = (1 << 13) - 1
    features["u"][:] = features["v"][:] = TINY.arithmetic.encode(16.0)
    entries = Entries(np.array([0, 600]), np.arange(600), np.full(600, 15))
    run = run_groups(simulation(TINY), TINY, features, entries, size)
    assert run.differing == 0 and run.result.samples["stop"].any()
    assert run.twin.counts["entries"] < 10 and run.counters["dropped"] > 500


@functools.cache
def scene_groups(name: str):
    """A real scene's features and lists, and 20 of its groups: the heaviest and some others."""
    gaussians = read_scene(scene_path(name)).gaussians()
    camera = read_camera(f"{scene_path(name.split('.')[0] + '.cameras.json')}:0")
    gaussians = as_packed(replace(gaussians, sh=gaussians.sh[:, :4]))
    splats, _ = project(gaussians, camera)
    entries = entries_of(DEFAULT, splats, camera)
    order = np.argsort(np.diff(entries.start))
    chosen = np.concatenate([order[-12:], order[:: len(order) // 12][:12]])
    size = camera.width, camera.height
    return features_of(DEFAULT, splats), entries, size, np.unique(chosen)


@needs_scenes
@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_scenes(name):
    features, entries, size, groups = scene_groups(name)
    for stall in (0, 0.3):
        run = run_groups(
            simulation(DEFAULT), DEFAULT, features, entries, size, groups, stall=stall
        )  # fmt: skip
        assert run.differing == 0 and len(groups) >= 20


@pytest.mark.parametrize("name", ["garden", *HARD])
def test_against_the_reference(name):
    """The twin's picture from the reference's splats; and marking loses nothing."""
    case = HARD[name](0) if name in HARD else None
    scene = case.scene if case else generate("garden", 5_000)
    camera = case.camera if case else generated_camera("garden", 320, 180)
    gaussians = as_packed(scene.gaussians())
    splats, _ = project(gaussians, camera)
    size = camera.width, camera.height
    features, entries = features_of(DEFAULT, splats), entries_of(DEFAULT, splats, camera)
    arguments = (DEFAULT, features, entries.start, entries.splat, entries.mask, size)
    twin, all_blocks = rasterize(*arguments), rasterize(*arguments, mark_all=True)
    assert (twin.pixels == all_blocks.pixels).all()
    assert twin.counts["contributions"] == all_blocks.counts["contributions"]
    error = twin.pixels / 255 - np.clip(render(gaussians, camera).image, 0, 1)
    assert np.mean(error**2) < 10**-5.2
