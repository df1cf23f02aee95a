"""Work in batches: the same results with other batches, and memory that grows with what is seen."""

import tracemalloc
from dataclasses import fields, replace

import numpy as np
import pytest

from splatcore.golden import batches, pipeline, reference
from splatcore.golden.points import project_points, splat_codes
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.cycles.frame import frame_cycles
from splatcore.spec import threads
from splatcore.spec.camera import Camera
from splatcore.spec.config import DEFAULT
from splatcore.spec.convention import ORIGINAL, SPLATCORE
from splatcore.spec.memory import CHUNK
from splatcore.spec.packed import PackedModel

FEW, MANY = 10_000, 60_000  # Gaussians behind the camera
BYTES = 20  # per Gaussian behind the camera, of arrays held at a time: mostly values of chunks

CAMERA = replace(generated_camera("garden").resized(160, 90), name="garden")
AMID = replace(CAMERA, translation=CAMERA.translation - [0, 0, 4])
"""A camera with a part of the garden behind it."""


@pytest.fixture(scope="module", params=["compact", "faithful", "small"])
def model(request) -> PackedModel:
    return pack(generate("garden")[::9][: 20 * CHUNK + 7], quality=request.param)[0]


@pytest.mark.parametrize("batch", [37, CHUNK - 1, 3 * CHUNK + 1])
def test_batches_change_no_bit(model, monkeypatch, batch):
    """Splats, frames, counts and cycles do not depend on the size of batches."""
    some = slice(None, 500) if batch == 37 else slice(None)
    drawn = model.gaussians()[some]
    whole = [reference.project(drawn, AMID, rule) for rule in (SPLATCORE, ORIGINAL)]
    frame = pipeline.render(DEFAULT, model, AMID) if batch > 37 else None
    monkeypatch.setattr(batches, "BATCH", batch)
    for rule, (splats, counts) in zip((SPLATCORE, ORIGINAL), whole, strict=True):
        found, own = reference.project(model.decoded(some), AMID, rule)
        assert own == counts and counts["near_culled"] and counts["visible"]
        for field in fields(splats):
            a, b = getattr(splats, field.name), getattr(found, field.name)
            assert a.dtype == b.dtype and a.tobytes() == b.tobytes(), field.name
    if frame:
        found = pipeline.render(DEFAULT, model, AMID)
        assert (found.pixels == frame.pixels).all() and found.counts == frame.counts
        assert frame_cycles(DEFAULT, found) == frame_cycles(DEFAULT, frame)


def test_whole_points(model):
    """A frame's points are a part of the values that testbenches compare."""
    points = project_points(DEFAULT, model, AMID)
    few = project_points(DEFAULT, model, AMID, whole=False)
    assert len(points.culled["z"]) == len(points.points) and len(points.placed["x"]) == len(
        points.front
    )
    for name in ("points", "front", "inside", "index", "step"):
        assert np.array_equal(getattr(points, name), getattr(few, name)), name
    codes = splat_codes(DEFAULT, points.projected)
    assert codes.keys() == few.codes.keys() == points.codes.keys()
    for name, code in codes.items():
        assert np.array_equal(code, few.codes[name]), name
        assert np.array_equal(code, points.codes[name]), name
    assert not few.culled and not few.placed and not few.projected


def test_decoded_is_a_part_of_all(model):
    """Gaussians decoded by number are those of the whole model, in any order."""
    index = np.random.default_rng(1).permutation(len(model))[:300]
    some, every = model.decoded(index), model.gaussians()
    for name in ("position", "factor", "opacity", "sh"):
        assert getattr(some, name).tobytes() == getattr(every, name)[index].tobytes(), name
    assert np.array_equal(model.beats[index], model.first_beats(index))


def peak(function, *arguments) -> int:
    """Bytes that a second call of a function allocates at a time."""
    function(*arguments)
    tracemalloc.start()
    try:
        function(*arguments)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def joined(behind: int) -> PackedModel:
    """A thousand Gaussians in view, and more of them behind the camera."""
    scene = generate("garden")[::20][:1000]
    away = -30 * AMID.rotation[2] - AMID.rotation[2]
    index = np.arange(1000 + behind) % 1000
    every = scene[index]
    jitter = np.random.default_rng(1).normal(size=(len(index), 3)) * (index[:, None] < 1000)
    position = every.position + np.where(np.arange(len(index))[:, None] < 1000, 0, away + jitter)
    return pack(replace(every, position=position), quality="faithful")[0]


@pytest.mark.parametrize("render", ["golden", "reference"])
def test_memory_grows_with_the_visible(render, monkeypatch):
    """A Gaussian behind the camera costs a few bytes at most, in the golden model and in the
    reference."""

    def draw(model: PackedModel, camera: Camera):
        if render == "golden":
            frame_cycles(DEFAULT, pipeline.render(DEFAULT, model, camera))
        else:
            reference.render(model, camera)

    monkeypatch.setattr(threads, "threads", lambda: 1)  # each further one holds batches
    monkeypatch.setattr(batches, "BATCH", 1 << 10)
    few, many = joined(FEW), joined(MANY)
    added = peak(draw, many, AMID) - peak(draw, few, AMID)
    assert added < BYTES * (MANY - FEW)
    front = project_points(DEFAULT, many, AMID, whole=False)
    assert len(front.inside) < len(many) / 10
