"""Chunks of a packed model: order, grid, octants, offsets, against plain integers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from splatcore.model.pack.chunk import chunk_positions, interleave, morton_order, smallest_shift
from splatcore.spec.decoded import grid_points, offsets
from splatcore.spec.memory import CHUNK, EXTENT_SHIFT, STORED_BITS, chunk_count

COUNTS = [1, 2, CHUNK - 1, CHUNK, CHUNK + 1, 5 * CHUNK + 7]
BITS = [15, 9]
"""Stored bits per offset: 15, in small models 9."""


def points(kind: str, count: int) -> np.ndarray:
    rng = np.random.default_rng(count)
    if kind == "cloud":
        return rng.normal(size=(count, 3))
    if kind == "equal":
        return np.full((count, 3), -3.7)
    if kind == "far":
        return 1e4 + rng.normal(size=(count, 3))
    if kind == "outlier":
        return np.where(np.arange(count)[:, None] == 0, 1e6, rng.normal(size=(count, 3)))
    return np.exp(rng.normal(0, 4, (count, 3))) * rng.choice([-1, 1], (count, 3))


def unpacked(chunks):
    offset = offsets(chunks.stored, chunks.octant_end, chunks.bits)
    grid = grid_points(offset, chunks.origin, chunks.shift)
    return np.ldexp(grid.astype(np.float64), chunks.exponent)


@pytest.mark.parametrize("kind", ["cloud", "equal", "far", "outlier", "wide"])
@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("bits", BITS)
def test_positions_come_back_within_half_a_step(kind, count, bits):
    position = points(kind, count)
    chunks = chunk_positions(position, bits)
    assert sorted(chunks.order) == list(range(count))
    chunk = np.arange(count) // CHUNK
    step = np.ldexp(1.0, chunks.exponent + chunks.shift[chunk] + STORED_BITS - bits)
    grid = np.ldexp(1.0, chunks.exponent)
    least = grid * 2 ** (STORED_BITS - bits)
    error = np.abs(unpacked(chunks) - position[chunks.order])
    assert (error <= step / 2 + grid).all()
    span = np.ptp(position[chunks.order][:CHUNK], axis=0)
    assert (step[0] <= np.maximum(span / 2**bits, least) * (1 + 2.0**-bits)).all()


@pytest.mark.parametrize("bits", BITS)
def test_offsets_by_plain_integers(bits):
    """Positions follow the formula of spec.memory, evaluated per Gaussian."""
    chunks = chunk_positions(points("wide", 600), bits)
    back = unpacked(chunks)
    for place in range(600):
        chunk, within = divmod(place, CHUNK)
        octant = sum(within >= end for end in chunks.octant_end[chunk])
        for axis in range(3):
            stored = int(chunks.stored[place, axis])
            assert stored < 2**bits
            offset = stored * 2 ** (15 - bits) + (octant >> axis & 1) * 2**15
            assert offset < 2**16
            integer = int(chunks.origin[chunk, axis]) + offset * 2 ** int(chunks.shift[chunk, axis])
            assert back[place, axis] == integer * 2.0**chunks.exponent
            assert offset >> EXTENT_SHIFT <= chunks.extent[chunk, axis]


@pytest.mark.parametrize("bits", BITS)
def test_fields_fit(bits):
    """Every stored field fits its width, for all kinds of point clouds."""
    for kind in ("cloud", "equal", "far", "outlier", "wide"):
        chunks = chunk_positions(points(kind, 700), bits)
        assert len(chunks.origin) == chunk_count(700)
        assert np.abs(chunks.origin).max() < 2**39
        assert chunks.shift.min() >= 0 and chunks.shift.max() < 32
        assert chunks.stored.min() >= 0 and chunks.stored.max() < 2**bits
        assert chunks.extent.max() < 2**8
        assert (np.diff(chunks.octant_end, axis=1) >= 0).all() and chunks.octant_end.max() <= CHUNK


def test_a_span_that_rounds_up_past_16_bits_takes_one_shift_more():
    spans = np.array([0, 65535, 65536, 131070, 131071, 131072, 2**40 - 1])
    assert list(smallest_shift(spans, 16)) == [0, 0, 1, 1, 2, 2, 25]


def plain_morton(x: int, y: int, z: int, bits: int) -> int:
    return sum((x >> k & 1) << 3 * k | (y >> k & 1) << 3 * k + 1 | (z >> k & 1) << 3 * k + 2
               for k in range(bits))  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(*[st.integers(0, 2**21 - 1)] * 3), min_size=1, max_size=8))
def test_interleave(rows):
    expected = [plain_morton(*row, 21) for row in rows]
    assert [int(code) for code in interleave(np.array(rows, np.uint64))] == expected


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-(2**38), 2**38)] * 3), min_size=1, max_size=40))
def test_morton_order(rows):
    low = [min(column) for column in zip(*rows, strict=True)]
    keys = [plain_morton(*(a - b for a, b in zip(row, low, strict=True)), 40) for row in rows]
    expected = sorted(range(len(rows)), key=lambda n: (keys[n], n))
    assert list(morton_order(np.array(rows, np.int64))) == expected


def test_neighbours_share_a_chunk():
    """Morton order keeps neighbours together: chunks of a unit cube span less than 0.4."""
    position = np.random.default_rng(0).uniform(size=(64 * CHUNK, 3))
    ordered = position[chunk_positions(position).order].reshape(-1, CHUNK, 3)
    assert np.median(np.ptp(ordered, axis=1)) < 0.4


def test_no_points():
    chunks = chunk_positions(np.zeros((0, 3)))
    assert unpacked(chunks).shape == (0, 3)
