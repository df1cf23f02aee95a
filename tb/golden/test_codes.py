"""Compiled codes against `spec.number.Float`: every code, random values, and the formats' ends."""

import numpy as np
import pytest

from splatcore.golden.codes import decode, encode, round_values
from splatcore.spec.colour import BASIS
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.depth import finer
from splatcore.spec.number import FP16, FP24, Float

FORMATS = {
    FP16, FP24, BASIS, DEFAULT.arithmetic, finer(DEFAULT).arithmetic, PAPER.arithmetic,
    Float(5, 10), Float(5, 10, signed=False), Float(4, 3, subnormal=False, overflow="infinity"),
    Float(10, 51), Float(2, 1),
}  # fmt: skip


def values_of(format: Float) -> np.ndarray:
    """Values of all sizes, and both neighbours of ties, of the ends and of the smallest numbers."""
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 1 << format.width, 4000, np.uint64, endpoint=False)
    exact = format.decode(codes)
    exact = exact[np.isfinite(exact)]
    ends = np.array([0.0, format.min_subnormal, format.min_normal, format.max, 1e300, 1e-300])
    ties = np.concatenate([exact, ends]) * (1 + format.epsilon)
    tiny = format.min_normal * np.array([0.5, 0.25, 0.75, 1.5, 1 - format.epsilon])
    found = np.concatenate([exact, ends, ties, tiny, format.min_subnormal * np.arange(9) / 2])
    found = np.concatenate([found, np.nextafter(found, 0), np.nextafter(found, np.inf)])
    return np.concatenate([found, -found, [np.inf, -np.inf]])


@pytest.mark.parametrize("format", sorted(FORMATS, key=str), ids=str)
def test_same_bits(format):
    values = values_of(format)
    codes = format.encode(values)
    found = encode(format, values)
    assert found.dtype == codes.dtype and (found == codes).all()
    assert round_values(format, values).tobytes() == format.round(values).tobytes()
    every = np.random.default_rng(2).integers(0, 1 << format.width, 9000, np.uint64)
    every = np.arange(1 << format.width, dtype=np.uint64) if format.width < 17 else every
    assert np.array_equal(decode(format, every), format.decode(every), equal_nan=True)
    assert decode(format, codes).tobytes() == format.decode(codes).tobytes()


def test_nan():
    """A NaN has the one code of IEEE 754, or is refused."""
    values = np.array([1.0, np.nan])
    assert (encode(FP16, values) == FP16.encode(values)).all()
    for function in (encode, round_values):
        with pytest.raises(ValueError, match="NaN"):
            function(FP24, values)
