"""The choice of levels in the golden model, and its cycles."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden import pipeline
from splatcore.golden.levels import cut, pixels_for
from splatcore.golden.points import project_points
from splatcore.golden.reference import render as render_reference
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.levels.build import with_levels
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.sim.cycles.preprocessing import level_costs
from splatcore.sim.frame.metric import psnr
from splatcore.spec.camera import LOD_MAX
from splatcore.spec.config import DEFAULT
from splatcore.spec.frame import frame_constants
from splatcore.spec.levels import groups, jumped
from splatcore.spec.memory import CHUNK
from splatcore.spec.microprogram import constants, program
from splatcore.spec.packed import PackedModel
from splatcore.spec.registers import variable_constants
from splatcore.spec.schedule import schedule
from tb.helpers.configs import ALPHA
from tb.helpers.level_models import clouds, views, with_records
from tb.helpers.refusal import refused

NONE = replace(DEFAULT, name="NONE", levels=False)
CAMERA = replace(generated_camera("garden").resized(160, 90), name="garden")
FAR = replace(CAMERA.resized(80, 45), translation=np.add(CAMERA.translation, [0, 0, 40]))
AMID = replace(CAMERA, translation=CAMERA.translation - [0, 0, 4])


@pytest.fixture(scope="module")
def models() -> tuple[PackedModel, PackedModel]:
    """A garden without levels, and with them."""
    plain, _ = pack(generate("garden", 40 * CHUNK - 30), DEFAULT, quality="compact")
    return plain, with_levels(plain, DEFAULT)[0]


def constants_of(model: PackedModel, camera):
    exponents = model.value("position_exponent"), model.value("factor_exponent")
    return frame_constants(DEFAULT, camera, *exponents)


def walk(levels, enough) -> list[int]:
    """The chunks that a machine draws, one by one."""
    drawn, k = [], 0
    while k < len(enough):
        if levels["error"][k] == 0 or enough[k]:
            drawn.append(k)
        k = int(levels["jump"][k]) if enough[k] and levels["last"][k] else k + 1
    return drawn


@pytest.mark.parametrize("seed", range(4))
def test_every_place_once(models, seed):
    """Whatever groups are coarse enough: each finest chunk is drawn, or one group above it."""
    levels = models[1].levels
    rng, count = np.random.default_rng(seed), len(levels["error"])
    enough = np.zeros(count, bool)
    for start, end, _ in groups(levels):
        enough[start:end] = rng.random() < rng.random()
    visited = ~jumped(levels, enough)
    drawn = np.flatnonzero(visited & (enough | (levels["error"] == 0))).tolist()
    assert drawn == walk(levels, enough)
    times = np.zeros(count, int)
    for start, end, jump in groups(levels):
        assert len({k in drawn for k in range(start, end)}) == 1
        times[end:jump] += start in drawn
    times[levels["error"] == 0] += np.isin(np.flatnonzero(levels["error"] == 0), drawn)
    assert (times[levels["error"] == 0] == 1).all()


@pytest.mark.parametrize("camera", [CAMERA, AMID], ids=["front", "amid"])
@pytest.mark.parametrize("pixels", [0.25, 1.0, 4.0, 1000.0])
def test_cut(models, camera, pixels):
    """The cut is the one of exact arithmetic, except where the error is within a rounding."""
    model = models[1]
    camera = replace(camera, lod_pixels=pixels)
    levels, step = model.levels, 2.0 ** model.value("position_exponent")
    depth = (levels["centre"] * step) @ camera.rotation[2] + camera.translation[2]
    most = pixels / max(camera.fx, camera.fy) * (depth - levels["radius"])
    coarse = levels["error"] > 0
    sure = np.abs(most - levels["error"]) > 2e-4 * np.abs(most)
    drawn, tested = cut(DEFAULT, constants_of(model, camera), model)
    expected = walk(levels, coarse & (levels["error"] < most))
    assert sure.all() and np.flatnonzero(drawn).tolist() == expected
    first = [start for start, *_ in groups(levels)]
    assert set(np.flatnonzero(tested)) <= set(first)


def test_equal_is_refined(models):
    """An error equal to the limit refines its group; the next smaller one does not."""
    model = models[1]
    plain = replace(CAMERA, rotation=np.eye(3), translation=np.zeros(3), fx=64.0, fy=32.0)
    limit, code = 2.0**-6, 2.0**-15  # at lod 1/64 and depth 1
    centre = np.zeros((len(model.levels["error"]), 3))
    centre[:, 2] = 1.5 * 2.0 ** -model.value("position_exponent")
    for error, enough in ((limit, False), (limit - code, True)):
        levels = model.levels | {"centre": centre, "radius": np.full(len(centre), 0.5)}
        levels["error"] = np.where(levels["error"] > 0, error, 0)
        changed = PackedModel(model.image, "changed")
        vars(changed)["levels"] = levels
        view = replace(plain, lod_pixels=1.0)
        drawn, _ = cut(DEFAULT, constants_of(model, view), changed)
        assert drawn[0] == enough and drawn.sum() == (2 if enough else 40)


def test_no_pixels_is_the_finest_level(models):
    """At 0 pixels pictures, counts and cycles of all later stages are those without levels."""
    plain, _ = models
    for camera in (CAMERA, AMID):
        frames = [pipeline.render(DEFAULT, each, camera) for each in models]
        assert np.array_equal(frames[0].pixels, frames[1].pixels)
        assert frames[0].counts == frames[1].counts
        one, other = (frame_cycles(DEFAULT, frame) for frame in frames)
        assert replace(one, chunk=other.chunk, preprocessing=other.preprocessing) == other
        assert one.preprocessing <= other.preprocessing < 1.2 * one.preprocessing
        assert frame_cycles(NONE, pipeline.render(NONE, plain, camera)) == one


def test_coarser_levels_cost_less(models):
    """From afar, half the Gaussians show the same picture, in half the cycles."""
    plain, model = models
    exact = render_reference(plain.gaussians(), FAR).pixels / 255
    frames = [
        pipeline.render(DEFAULT, model, replace(FAR, lod_pixels=pixels)) for pixels in (0.0, 1.0)
    ]
    read = [frame.counts["points_read"] for frame in frames]
    cycles = [frame_cycles(DEFAULT, frame).frame for frame in frames]
    assert read[1] < 0.5 * read[0] and cycles[1] < 0.5 * cycles[0]
    assert psnr(frames[1].pixels / 255, exact) > 55


def test_groups_out_of_view():
    """They are left out: of a cloud of small Gaussians the same ones are projected, of fewer
    chunks, from outside and inside, with narrow and wide lenses."""
    _, model = clouds(ALPHA, 120, size=0.01)
    unknown, spared = with_records(model, around=0), 0
    for k, camera in enumerate(views(60)):
        view = replace(camera, lod_pixels=k % 2)
        some, all = (project_points(ALPHA, each, view, False) for each in (model, unknown))
        assert np.array_equal(some.inside, all.inside)
        spared += all.drawn.sum() - some.drawn.sum()
    assert spared > 100


def test_cycles_of_levels(models):
    """A group is tested like a header; other records and headers take four cycles each, until the
    reader has turned."""
    found = [project_points(DEFAULT, each, replace(FAR, lod_pixels=1.0), False) for each in models]
    assert not level_costs(DEFAULT, found[0], 80).any()
    tested, drawn = found[1].tested, found[1].drawn
    test = schedule(DEFAULT, program("chunk")).length + 17
    for latency, wait in ((4, 0), (80, 48)):
        costs = level_costs(DEFAULT, found[1], latency)
        assert tested.any() and (costs[tested] == test + 4 * ~drawn[tested]).all()
        assert (costs[drawn & ~tested] == 4).all()
        left, at = np.flatnonzero(~drawn & ~tested), 0
        for run in np.split(left, np.flatnonzero(np.diff(left) > 1) + 1):
            at = max(at, len(run))
            assert costs[run].tolist() == ([8] * 8 + [wait] + [0] * len(run))[: len(run)]
        assert at > 10


def test_budget(models):
    """The fewest pixels with which at most so many Gaussians are read."""
    model = models[1]
    for most, least in ((20_000, 0), (8_000, None), (1_000, LOD_MAX)):
        pixels = pixels_for(DEFAULT, model, FAR, most)
        views = [replace(FAR, lod_pixels=each) for each in (pixels, 0.999 * pixels)]
        enough, more = (cut(DEFAULT, constants_of(model, v), model)[0].sum() for v in views)
        assert pixels == least or enough * CHUNK - 30 <= most < more * CHUNK - 30


def test_machines_without_levels(models):
    refused("has levels of detail, preset NONE", pipeline.render, NONE, models[1], CAMERA)
    assert "lod" in constants(DEFAULT) and "lod" in variable_constants(DEFAULT)
    assert "lod" not in constants(NONE) and "lod" not in variable_constants(NONE)
