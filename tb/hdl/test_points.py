"""Stages 0 and 1 on real Gaussians: hardware against golden model, golden against reference."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.golden import points as golden_points
from splatcore.golden.pipeline import render
from splatcore.golden.points import Points, chunk, cull, project_points, rays
from splatcore.golden.program import run
from splatcore.golden.reference import covariance_and_conic, project
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.generate.hard_case import straight_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import DEFAULT, PAPER, TINY
from splatcore.spec.convention import NEAR_PLANE, SPLATCORE
from splatcore.spec.depth import finer, whole_depth
from splatcore.spec.memory import CHUNK, EXTENT_SHIFT, chunk_count
from splatcore.spec.microprogram import projection
from splatcore.spec.point import (
    BEATS_BITS,
    FETCH,
    GAUSSIAN_BITS,
    NUMBER_BITS,
    chunk_record,
    projecting_record,
)
from tb.helpers.point_rows import PointRows, point_rows
from tb.helpers.runs import marked
from tb.helpers.scene_frames import POINT_SCENES, parameters, scene_frame
from tb.stages.points import PARTS, check, with_harmonics


def points(name: str) -> tuple:
    """Return model, camera and golden results of a scene's first camera."""
    return scene_frame(name)[1:]


def rows(name: str) -> PointRows:
    """Return the rows of every stream."""
    model, camera, _ = points(name)
    return point_rows(DEFAULT, model, camera)


@pytest.mark.slow
@pytest.mark.parametrize("stage", marked(PARTS, ["points"]))
def test_stages_equal_golden_on_the_garden(stage):
    for seed, stall in enumerate((0, 0.3, 0.7)):
        check(stage, rows("garden"), stall, seed)


GARDEN = generated_camera("garden")
AMID = replace(GARDEN, translation=GARDEN.translation - [0, 0, 4])
"""A camera with a part of the garden behind it, and a part outside its view."""

MACHINES = {
    "two arrays, nothing culled": (replace(DEFAULT, pes=7, pe_arrays=2, culling="none"), 4),
    "dense, interval, near plane alone culls": (
        replace(DEFAULT, pes=6, skip_zeros=False, depth_interval=True, culling="near"), 13
    ),
    "no harmonics, 3σ square": (replace(TINY, sh_degree=0, tile_test="3sigma"), 7),
    "paper": (PAPER, 12),
}  # fmt: skip
"""Machines other than DEFAULT, and their cycles per Gaussian."""


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(MACHINES, MACHINES.keys() - {"paper"}))
def test_machines_equal_golden(name):
    config, interval = MACHINES[name]
    model, _ = pack(generate("garden", 3000), config)
    frame = point_rows(config, model, AMID if "cull" in name else GARDEN)
    cycles = check("points", frame, 0).cycles
    check("points", frame, 0.4)
    points, projected = len(frame.points.points), len(frame.points.inside)
    least = max(interval * projected, 4 * points)  # culling limits if projection is fast
    assert least < cycles < 1.1 * least


@pytest.mark.slow
@pytest.mark.parametrize("quality", ["small", "balanced", "faithful", "mixed"])
def test_models_of_all_qualities_equal_golden(quality):
    """Half a beat per Gaussian; and harmonics of degree 3, in chunks of one layout or of all."""
    rng = np.random.default_rng(3)
    scene = with_harmonics(generate("garden", 5000), rng)
    if quality == "mixed":
        quality = rng.integers(0, len(LAYOUTS), chunk_count(len(scene)))
    model, _ = pack(scene, quality=quality)
    frame = point_rows(DEFAULT, model, AMID)
    assert 0 < len(frame.points.index) < len(model)
    check("points", frame, 0)
    check("points", frame, 0.4)


ANTIALIASED = {name: config for name, (config, _) in MACHINES.items() if config.compensates} | {
    "default": DEFAULT,
    "colours in the array": replace(DEFAULT, colours="array", sh_degree=1, pes=9),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", marked(ANTIALIASED, MACHINES))
def test_antialiased_models_equal_golden(name):
    """Splats of some pixels, and splats below a pixel with hardly any opacity left."""
    config = ANTIALIASED[name]
    scene = replace(generate("garden", 3000), antialiased=True)
    scene.scale[::2] *= np.exp2(-(np.arange(len(scene.scale[::2])) % 10))[:, None]
    model, _ = pack(scene, config)
    frame = point_rows(config, model, AMID)
    stored = model.attributes["opacity"][frame.points.index]
    faded = frame.points.projected["attenuation"] - stored
    assert (faded < 0.1).any() and (faded > 100).any() and (faded + stored > 256).any()
    check("points", frame, 0)
    check("points", frame, 0.4)


@pytest.mark.slow
def test_chunks_share_no_beat_of_a_small_model():
    """In each of two chunks only the last two Gaussians are in front of the camera: both chunks
    need one beat, at the same place, and each is read."""
    number = np.arange(2 * CHUNK)
    near = NEAR_PLANE + np.where(number % CHUNK > 1, -1, 1) * 2**-14
    position = np.stack([number * 2.0**-12, 0 * near, near], axis=1)  # in this order in both
    scene = replace(generate("garden", len(number)), position=position)
    scene.opacity[:] = 0.5
    model, _ = pack(scene, TINY, quality="small")
    frame = point_rows(TINY, model, straight_camera(64, 48))
    inside = np.array([CHUNK - 2, CHUNK - 1])
    assert list(frame.points.inside) == [*inside, *inside + CHUNK]
    check("points", frame, 0)


def test_chunk_records():
    """The golden side's chunk records against plain integers."""
    rng = np.random.default_rng(0)
    scene = with_harmonics(generate("garden", 8000), rng)
    model, _ = pack(scene, quality=rng.integers(0, len(LAYOUTS), chunk_count(len(scene))))
    frame = point_rows(DEFAULT, model, AMID)
    codes, read = chunk_record(DEFAULT).unpack(frame.streams["chunks"]), frame.points.read
    skipped = np.flatnonzero(~read)
    assert (model.chunk_beats[skipped[skipped < np.flatnonzero(read).max()]] > 1).any()
    beats, number = 0, 0
    for place, layout in enumerate(model.chunks["harmonics"].tolist()):
        if read[place]:
            assert codes["projecting"]["attributes"][number] == beats
            assert codes["projecting"]["harmonics"][number] == layout
            assert codes["fetch"]["number"][number] == place
            number += 1
        beats += min(CHUNK, len(model) - place * CHUNK) * (1 + [0, 1, 1, 2][layout])
    assert model.layout.attributes + 16 * beats <= model.layout.end


def test_the_largest_model_fits():
    """Chunk numbers and sums of beats fit their bits for any count of Gaussians."""
    most, last = (1 << GAUSSIAN_BITS) - 1, (1 << GAUSSIAN_BITS - 8) - 1
    assert most // CHUNK == last < 1 << NUMBER_BITS == 1 << FETCH["number"].width
    beats = max(1 + layout.beats for layout in LAYOUTS) * most
    assert beats < 1 << BEATS_BITS == 1 << projecting_record()["attributes"].width


def test_culling_leaves_the_same_splats():
    """Without culling, as in the ablation, more Gaussians are projected, for the same picture."""
    model, _ = pack(generate("garden", 3000), DEFAULT)
    found = {
        culling: render(replace(DEFAULT, culling=culling), model, AMID)
        for culling in ("all", "near", "none")
    }
    points = {culling: frame.points for culling, frame in found.items()}
    projected = {culling: len(p.inside) for culling, p in points.items()}
    assert projected["all"] < projected["near"] < projected["none"] == len(model)
    assert len(points["none"].index) == len(points["near"].index)
    for frame in found.values():
        assert np.array_equal(frame.pixels, found["all"].pixels)


@pytest.mark.parametrize("quality", ["small", "compact"])
def test_points_every_three_cycles(quality):
    """Parts before the projection of a machine that projects a Gaussian every 4 cycles."""
    config = DEFAULT
    frame = point_rows(config, pack(generate("garden", 6000), config, quality=quality)[0], GARDEN)
    for stage, count in (("cull", len(frame.points.step)), ("place", len(frame.points.front))):
        assert 3 < check(stage, frame, 0).cycles / count < 3.15, stage
        check(stage, frame, 0.4)


@pytest.mark.parametrize("file", parameters(POINT_SCENES))
def test_points_equal_golden(file):
    frame = rows(file)
    assert len(frame.points.points) > 20_000
    check("points", frame, 0)
    check("points", frame, 0.4, seed=len(file))


@pytest.mark.parametrize("name", ["garden", *parameters(POINT_SCENES)])
def test_skipped_chunks_hold_nothing_visible(name):
    """Skipping chunks by their headers changes no result, only the amount read."""
    model, camera, result = points(name)

    def read_all(config, frame, model):
        values, kept = chunk(config, frame, model)
        return values, np.ones_like(kept)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("splatcore.golden.points.chunk", read_all)
        whole = project_points(DEFAULT, model, camera)
    assert (whole.index == result.index).all()
    assert len(whole.points) == len(model) >= len(result.points)
    assert name != "garden" or len(result.read) > result.read.sum()


@pytest.mark.parametrize("marked", [False, True])
@pytest.mark.parametrize("tile_test", ["exact", "3sigma"])
def test_zeros_change_no_bit(tile_test, marked):
    """The dense program gives the same values as the program without zeros, bit for bit."""
    _, _, result = points("garden")
    inputs = result.frame.constants | result.projected
    inputs |= {"stored_attenuation": inputs["attenuation"], "antialiased": float(marked)}
    config = replace(DEFAULT, tile_test=tile_test)
    steps = projection(config)
    sparse = run(DEFAULT, steps, inputs)
    dense = run(DEFAULT, projection(replace(config, skip_zeros=False)), inputs)
    for name in steps.outputs:
        assert (sparse[name] == dense[name]).all(), name


def largest(found: np.ndarray, exact: np.ndarray, scale: np.ndarray) -> float:
    """Return the largest |found − exact| / scale, in half steps of the format."""
    return float(np.max(np.abs(found - exact) / scale) / DEFAULT.arithmetic.epsilon)


@pytest.mark.parametrize("name", ["garden", *parameters(POINT_SCENES)])
def test_golden_against_the_reference(name):
    """Each output is within a few roundings of 17 significant bits.

    A rounding is relative to the largest summand: to the distance from the camera along the world
    axes, not to the point's own coordinates; and to the largest extent that a Gaussian of its size
    can have, `spread`, not to its visible extent. Without opacity compensation.
    """
    _, model, camera, result = scene_frame(name, marked=False)
    gaussians, values = model.gaussians(), result.projected
    point = gaussians.position[result.index] @ camera.rotation.T + camera.translation
    depth = point[:, 2]
    way = sum(np.abs(ray) for ray in rays(DEFAULT, result.frame, model, result.index).values())
    assert largest(values["z"], depth, way) < 4
    slant = way / depth  # error of x/z and y/z grows with it
    for axis, focal, name, centre in (
        (0, camera.fx, "u", camera.cx - 0.5),
        (1, camera.fy, "v", camera.cy - 0.5),
    ):
        slope = point[:, axis] / depth * focal
        scale = focal * slant * (1 + np.abs(slope) / focal) + np.abs(slope + centre)
        assert largest(values[name], slope + centre, scale) < 2
    factor = gaussians.factor[result.index]
    cov, *_ = covariance_and_conic(factor, point, camera, SPLATCORE)
    sigma = np.linalg.svd(factor, compute_uv=False)[:, 0] / depth
    reach = 2 * np.log(255 * gaussians.opacity[result.index])
    full = 2 * np.log(255)
    deviations = np.sqrt(reach) + full / np.sqrt(reach)  # reach is a difference from `full`
    for row, half, focal, tangent in (
        (0, "half_width", camera.fx, camera.tan_half_fov[0]),
        (2, "half_height", camera.fy, camera.tan_half_fov[1]),
    ):
        spread = np.hypot(1, 1.3 * tangent) * focal * sigma + 1
        exact = np.sqrt(reach * cov[:, row])
        assert largest(values[half], exact, deviations * spread * slant) < 6
    assert (values["across"] > 0).all() and (values["along"] > 0).all()  # positive definite
    # All Gaussians that the reference draws are kept, except within an error of the near plane.
    splats, _ = project(gaussians, camera)
    visible = splats.index[splats.depth > NEAR_PLANE * 1.001]
    assert not len(np.setdiff1d(visible, result.index))


def test_depths_are_finer():
    """z with its low bits, for the rounded view row: within a few roundings of 21 bits."""
    model, _, result = points("garden")
    way = (model.grid[result.index] - result.frame.camera).astype(np.float64)
    way = np.ldexp(way, model.value("position_exponent"))
    exact = way @ [result.frame.constants[f"vz{k}"] for k in range(3)]
    z, low = result.projected["z"], result.projected["z_low"]
    error = np.abs([whole_depth(DEFAULT, z, low) - exact, z - exact])
    finer_error, error = (error / np.abs(way).sum(1)).max(1) / finer(DEFAULT).arithmetic.epsilon
    assert finer_error < 3 and error > 8


def test_no_point_is_beyond_its_chunks_bounds():
    """A chunk's bound on z holds even for a point at its corner, in the finer format."""
    model, _, result = points("garden")
    headers, fine = model.chunks, finer(DEFAULT)
    low = headers["origin"].astype(np.int64) - result.frame.camera
    size = headers["extent"].astype(np.int64) + 1 << headers["shift"] + EXTENT_SHIFT
    falls = [result.frame.constants[f"vz{k}"] < 0 for k in range(3)]
    bound = result.chunks["z_high"]
    way = np.ldexp(np.where(falls, low, low + size).astype(float), model.value("position_exponent"))
    rays = {f"ray_{axis}": fine.arithmetic.round(way[:, k]) for k, axis in enumerate("xyz")}
    values = cull(DEFAULT, result.frame, rays)[0]
    assert (values["z"] <= bound).all()


def test_a_chunk_on_the_near_plane(monkeypatch):
    """Hardware keeps a chunk whose depth bound is one code beyond the near plane."""
    model, camera, result = points("garden")
    bound = np.sort(result.chunks["z_high"])[len(result.chunks["z_high"]) // 2]
    near = float(DEFAULT.arithmetic.decode(DEFAULT.arithmetic.encode(bound) - 1))
    frame = replace(result.frame, near_plane=near)
    monkeypatch.setattr(golden_points, "frame_constants", lambda *_: frame)
    rows = point_rows(DEFAULT, model, camera)
    assert 0 < rows.points.read.sum() < len(rows.points.read)
    check("chunk", rows, 0)


def test_culling_agrees_with_the_reference():
    model, camera, result = points("garden")
    depth = model.position @ camera.rotation[2] + camera.translation[2]
    certain = np.abs(depth - NEAR_PLANE) > 1e-4 * (np.abs(depth) + 10)
    kept = np.zeros(len(model), bool)
    kept[result.front] = True
    assert (kept == (depth > NEAR_PLANE))[certain].all()
    assert 0 < (~kept).sum() < len(model) and isinstance(result, Points)
