"""Compiled and batched code of the golden model against the plain definitions, bit for bit."""

import numpy as np
import pytest

from splatcore.golden import batches
from splatcore.golden.pe import ABSENT, evaluate
from splatcore.golden.pipeline import render
from splatcore.model.generate.generate import generated_camera
from splatcore.spec import unary
from splatcore.spec.config import DEFAULT, PAPER
from splatcore.spec.number import FP16, FP24, Float, code_dtype
from tb.helpers.machines import garden

FORMATS = (
    FP16, FP24, Float(7, 20, subnormal=False), Float(4, 3), Float(8, 23, overflow="infinity"),
    Float(5, 10, signed=False, subnormal=False), Float(5, 6, overflow="infinity", subnormal=False),
)  # fmt: skip


def values_for(format: Float) -> np.ndarray:
    """Return floats of all sizes, values of the format, midpoints between them, and limits."""
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 1 << format.width, 20_000).astype(code_dtype(format.width))
    own = np.sort(format.decode(codes))
    near = np.unique(format.decode(np.arange(2000).astype(code_dtype(format.width))))
    ties = [(some[1:] / 2 + some[:-1] / 2) for some in (own, near, -near)]
    bits = rng.integers(0, 1 << 64, 20_000, dtype=np.uint64).view(np.float64)
    normal = rng.standard_normal(20_000) * 2.0 ** rng.integers(-80, 80, 20_000)
    ends = [0.0, -0.0, np.inf, -np.inf, np.nan, format.max, format.min_normal / 2]
    ends += [format.max * (1 + 2.0 ** -(format.fraction + 2)), format.max * 1.5]
    found = np.concatenate([own, *ties, bits, normal, ends])
    return found if format.overflow == "infinity" else found[np.isfinite(found)]


@pytest.mark.parametrize("format", FORMATS, ids=str)
def test_rounding(format):
    """Products and sums equal float64's, rounded by the format, including the sign of zero."""
    a, b = values_for(format), np.roll(values_for(format), 7)
    with np.errstate(all="ignore"):
        exact = [a * b, a + b, b - a]
    values = np.stack([a, b, *exact])
    steps = [[2, 0, 1, ABSENT, 0], [3, 0, ABSENT, 1, 0], [4, 0, ABSENT, 1, 1]]
    evaluate(np.array(steps), values, format)
    for found, wanted in zip(values[2:], exact, strict=True):
        known = ~np.isnan(wanted) | (format.overflow == "infinity")  # other formats have no NaN
        found, wanted = found[known], format.round(wanted[known])
        assert np.array_equal(found, wanted, equal_nan=True)
        assert np.array_equal(np.signbit(found), np.signbit(wanted))


def check_equal(found: dict, wanted: dict):
    """Check that values are equal by name, NaN included."""
    assert list(found) == list(wanted)
    for name, values in wanted.items():
        assert np.array_equal(found[name], values, equal_nan=True), name


@pytest.mark.parametrize("config", [DEFAULT, PAPER], ids=lambda config: config.name)
def test_batches_change_nothing(config, monkeypatch):
    def frame():
        return render(config, garden(config, 3_000), generated_camera("garden", 160, 90))

    whole = frame()
    monkeypatch.setattr(batches, "BATCH", 100)
    parts = frame()
    for found, wanted in ((parts.points, whole.points), (parts.binned, whole.binned)):
        for name, value in vars(wanted).items():
            if isinstance(value, dict):
                check_equal(vars(found)[name], value)
            elif isinstance(value, np.ndarray):
                check_equal({name: vars(found)[name]}, {name: value})
    assert np.array_equal(parts.pixels, whole.pixels) and parts.counts == whole.counts


@pytest.mark.parametrize("function", ["reciprocal", "rsqrt"])
@pytest.mark.parametrize("fraction", [3, 10, 16, 23])
def test_exact_by_float64(function, fraction):
    """Also if the result is an integer in the last place, which float64 may put just below it."""
    rng = np.random.default_rng(0)
    values = np.unique([0, (1 << fraction) - 1, *rng.integers(0, 1 << fraction, 3000)])
    for parity, below in ((0, 12), (1, 12), (0, 24)):
        found = unary._exact_array(function, fraction, parity, values, below)
        wanted = [unary._exact(function, fraction, parity, int(v), below) for v in values]
        assert found.tolist() == wanted
