"""Levels of detail in hardware: the chunks that are drawn are those of the golden model."""

from dataclasses import replace

import numpy as np
import pytest

from splatcore.hdl.points.chunk import Chunk
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.camera import LOD_MAX, Camera
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.frame import frame_constants
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import REACH, chunk_count, step_format
from splatcore.spec.packed import PackedModel
from tb.helpers.colour_rows import random_model
from tb.helpers.configs import ALPHA
from tb.helpers.level_models import LIMIT, STRAIGHT, at_depth_one, clouds, ties, views, with_records
from tb.helpers.point_rows import point_rows
from tb.helpers.runs import compiled
from tb.stages.points import GARDEN, check, point_case

pytestmark = pytest.mark.slow

CHUNKS = 40
FAR, AMID = (replace(GARDEN, translation=np.add(GARDEN.translation, [0, 0, z])) for z in (10, -4))


def unit() -> Simulation:
    return compiled(Chunk, ALPHA, samples=("fault",))


def drawn(model: PackedModel, camera: Camera, pixels: float, stall: float = 0.3) -> np.ndarray:
    """Compare the chunk unit with the golden model; the chunks that the view needs."""
    rows = point_rows(ALPHA, model, replace(camera, lod_pixels=pixels))
    result = point_case("chunk", rows).check(unit(), "chunk.", stall=stall)
    assert not result.samples["fault"].any()
    return rows.points.drawn


@pytest.mark.parametrize("camera", [FAR, AMID], ids=["far", "amid"])
def test_cuts(camera):
    """From the finest level to the coarsest; the fewest chunks from afar."""
    _, model = clouds(ALPHA, CHUNKS)
    found = [drawn(model, camera, pixels).sum() for pixels in (0, 0.25, 1, 4, LOD_MAX)]
    assert found[0] == CHUNKS > found[-1] and found == sorted(found, reverse=True)
    for stall in (0, 0.7):
        drawn(model, camera, 1, stall)


def test_models_without_levels_take_no_cycle_more():
    plain, _ = clouds(ALPHA, CHUNKS)
    machines = TINY, replace(TINY, name="NONE", levels=False)
    cycles = [check("chunk", point_rows(config, plain, AMID), 0).cycles for config in machines]
    assert cycles[0] == cycles[1]


def test_equal_errors():
    """A group whose error is the limit is refined; with the next smaller error, or the next larger
    limit, it is drawn. On a coarse grid, where ends of chunks would be apart."""
    _, model = clouds(ALPHA, CHUNKS, 2.0**15)
    limit = int(REACH.encode(LIMIT))
    equal = at_depth_one(model, error=limit)
    assert drawn(equal, STRAIGHT, 1).sum() == CHUNKS
    assert drawn(equal, STRAIGHT, 1 + 2.0**-15).sum() == 2
    assert drawn(at_depth_one(model, error=limit - 1), STRAIGHT, 1).sum() == 2
    assert 2 < drawn(ties(model), STRAIGHT, 1).sum() < CHUNKS


def test_groups_out_of_view():
    _, model = clouds(ALPHA, 120, size=0.01)
    unknown, spared = with_records(model, around=0), 0
    for k, camera in enumerate(views(12)):
        some, all = (drawn(each, camera, k % 2).sum() for each in (model, unknown))
        spared += all - some
    assert spared > 20


@pytest.mark.parametrize("around", [2.0**-20, 1.0])
def test_groups_at_the_edge(around):
    """Centres within 1/16 of the side beyond which groups are out of view."""
    _, model = clouds(ALPHA, CHUNKS)
    group = np.cumsum(np.append(True, model.levels["last"][:-1] > 0)) - 1
    rng, step = np.random.default_rng(0), 2.0 ** model.value("position_exponent")
    constants = frame_constants(ALPHA, STRAIGHT, 0, 0).constants
    guard, surround = (constants[name] / constants["vx0"] for name in ("guard_x", "surround"))
    side = 4 * guard + around * surround
    for sign in (1, -1):
        aside = sign * side * rng.uniform(15 / 16, 33 / 32, group[-1] + 1)
        aside[0] = 0
        centre = np.column_stack([aside, 0 * aside, 4 + 0 * aside]) / step
        fields = {"centre": LEVEL["centre"].encode(centre[group]), "radius": 1}
        edge = with_records(model, **fields, around=int(REACH.encode(around)))
        assert 0 < drawn(edge, STRAIGHT, 0).sum() < CHUNKS


@pytest.mark.parametrize("radius, enough", [(1.0, False), (1.0 - 2.0**-9, True), (4e9, False)])
def test_spheres_at_the_camera(radius, enough):
    """A sphere that touches the plane through the camera is refined, at any number of pixels."""
    _, model = clouds(ALPHA, CHUNKS)
    centre = np.zeros((chunk_count(model.count), 3))
    centre[:, 2] = 2.0 ** -model.value("position_exponent")
    fields = {"centre": LEVEL["centre"].encode(centre), "radius": int(REACH.encode(radius))}
    found = drawn(with_records(model, **fields), STRAIGHT, LOD_MAX)
    assert found.sum() == (2 if enough else CHUNKS)


def test_ends_of_the_formats():
    """Smallest and largest errors and spheres, at centres in all corners of the grid."""
    _, model = clouds(ALPHA, CHUNKS)
    rng, coarse = np.random.default_rng(0), model.levels["error"] > 0
    first = np.cumsum(np.append(True, model.levels["last"][:-1] > 0)) - 1
    ends = int(REACH.encode(REACH.max)) * np.array([0, 0, 1, 1]) + [1, 2, -1, 0]
    for _ in range(4):
        error, radius = (rng.choice(ends, len(coarse))[first] for _ in range(2))
        corner = rng.choice([-(2.0**39), -1, 0, 2.0**39 - 1], (len(coarse), 3))[first]
        fields = {"error": np.where(coarse, error, 0), "radius": radius}
        fields["centre"] = LEVEL["centre"].encode(corner)
        fields["around"] = rng.choice(ends, len(coarse))[first]
        drawn(with_records(model, **fields), FAR, rng.choice([1e-3, 1, LOD_MAX]))


@pytest.mark.parametrize("chunks", [1, 3])
def test_no_coarser_level(chunks):
    """One chunk alone, and too few for a group: all chunks are finest."""
    _, model = clouds(ALPHA, chunks)
    assert drawn(model, FAR, LOD_MAX).all() and len(model.levels["jump"]) == chunks


@pytest.mark.parametrize("field, change, chunk", [
    ("jump", lambda jump: 0 * jump, 0),
    ("jump", lambda jump: jump + 1000, 0),
    ("jump", lambda jump: jump + 1, -1),
    ("error", lambda error: 0 * error, 1),
    ("last", lambda last: 0 * last, 1),
])  # fmt: skip
def test_contradictions_are_reported(field, change, chunk):
    """A record that contradicts its place; the unit takes all headers all the same."""
    _, model = clouds(ALPHA, 5)
    rows = point_rows(ALPHA, model, replace(FAR, lod_pixels=1.0))
    codes = LEVEL.unpack(rows.streams["headers"][::2])
    codes[field][chunk] = change(codes[field][chunk])
    rows.streams["headers"][::2] = LEVEL.pack(codes)
    case = point_case("chunk", rows)
    result = unit().run(case.inputs, constants=case.constants)
    assert result.samples["fault"].any() and result.taken["i"] == len(case.inputs["i"])


OTHER = ({"culling": "none"}, {"culling": "near", "depth_interval": True}, {"colours": "array"})


@pytest.mark.verify
@pytest.mark.parametrize("changes", OTHER, ids=str)
def test_other_machines(changes):
    config = replace(DEFAULT, name="LEVELS", sh_degree=1, **changes)
    rows = point_rows(config, clouds(config, 9)[1], replace(FAR, lod_pixels=0.6))
    assert 2 < rows.points.drawn.sum() < 9
    check("chunk", rows, 0.3)


@pytest.mark.verify
@pytest.mark.parametrize("stall", [0, 0.3])
def test_points_of_a_cut(stall):
    """Stages 0 and 1 as a whole: points of the chunks that are drawn, in their order."""
    _, model = clouds(ALPHA, CHUNKS)
    rows = point_rows(ALPHA, model, replace(FAR, lod_pixels=1.0))
    assert 2 < rows.points.drawn.sum() < CHUNKS
    check("points", rows, stall)


@pytest.mark.verify
def test_many_chunks():
    """65,537 chunks, of which a view draws the first two and the last two."""
    count, zeros = (1 << 16) + 1, lambda rng, shape: np.zeros(shape, np.uint8)
    format = replace(step_format(ALPHA, 0), levels=True)
    layouts, rng = np.zeros(count, np.int64), np.random.default_rng(0)
    model = random_model(format, layouts, [-3] * 4, rng, zeros)
    jump = np.arange(count) + 1
    jump[:2] = count - 2
    records = {"jump": jump, "beats": jump, "last": np.arange(count) > 0}
    records["error"] = np.where(np.arange(count) < 2, 1, 0)
    model = with_records(model, **records)
    assert np.flatnonzero(drawn(model, FAR, 1, 0)).tolist() == [0, 1, count - 2, count - 1]
