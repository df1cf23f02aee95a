"""Chunk headers: where a chunk's attributes begin, with any layouts and skipped chunks before."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from splatcore.hdl.points.chunk import Chunk
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.spec.colour import LAYOUTS
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.memory import CHUNK, chunk_count
from splatcore.spec.packed import PackedModel
from splatcore.spec.point import (
    BEATS_BITS,
    FETCH,
    GAUSSIAN_BITS,
    NUMBER_BITS,
    chunk_record,
    projecting_record,
)
from tb.helpers.point_rows import PointRows, point_rows
from tb.helpers.runs import compiled
from tb.stages.points import point_case, with_harmonics

GARDEN = generated_camera("garden")
AMID = replace(GARDEN, translation=GARDEN.translation - [0, 0, 4])
"""A camera with a part of the garden behind it."""

pytestmark = pytest.mark.slow


@cache
def mixed(seed: int, count: int = 8000) -> PackedModel:
    """Return the garden with random harmonics of degree 3, in chunks of random layouts."""
    rng = np.random.default_rng(seed)
    scene = with_harmonics(generate("garden", count), rng)
    return pack(scene, quality=rng.integers(0, len(LAYOUTS), chunk_count(count)))[0]


def check(rows: PointRows, stall: float, seed: int):
    """Check two frames: the first leaves no state for the second."""
    case = point_case("chunk", rows).twice()
    case.check(compiled(Chunk, rows.config), "chunk.", stall=stall, seed=seed)


@pytest.mark.parametrize("stall", [0, 0.3, 0.7])
def test_mixed_layouts(stall):
    for seed in range(3):
        model = mixed(seed)
        rows = point_rows(DEFAULT, model, AMID)
        kept, skipped = np.flatnonzero(rows.points.read), np.flatnonzero(~rows.points.read)
        assert (model.chunk_beats[skipped[skipped < kept.max()]] > 1).any()
        assert len(model) % CHUNK and kept.max() == len(model) // CHUNK
        check(rows, stall, seed)


def test_records():
    """The golden side's chunk records against plain integers."""
    model = mixed(0)
    rows = point_rows(DEFAULT, model, AMID)
    codes = chunk_record(DEFAULT).unpack(rows.streams["chunks"])
    beats, number = 0, 0
    for chunk, read in enumerate(rows.points.read):
        layout = int(model.chunks["harmonics"][chunk])
        if read:
            assert codes["projecting"]["attributes"][number] == beats
            assert codes["projecting"]["harmonics"][number] == layout
            assert codes["fetch"]["number"][number] == chunk
            number += 1
        beats += min(CHUNK, len(model) - chunk * CHUNK) * (1 + [0, 1, 1, 2][layout])
    assert model.layout.attributes + 16 * beats <= model.layout.end


def test_compact_models_of_arrays():
    model, _ = pack(generate("garden", 1000), PAPER)
    check(point_rows(PAPER, model, GARDEN), 0.3, 0)


def test_the_largest_model_fits():
    """Chunk numbers and sums of beats fit their bits for any count of Gaussians."""
    most, last = (1 << GAUSSIAN_BITS) - 1, (1 << GAUSSIAN_BITS - 8) - 1
    assert most // CHUNK == last < 1 << NUMBER_BITS == 1 << FETCH["number"].width
    beats = max(1 + layout.beats for layout in LAYOUTS) * most
    assert beats < 1 << BEATS_BITS == 1 << projecting_record()["attributes"].width
