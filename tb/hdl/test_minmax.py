"""Clamp and maximum: every pair of codes of a small format, hard pairs of the real one."""

import numpy as np
import pytest

from splatcore.hdl.arithmetic.minmax import Clamp, Maximum
from splatcore.sim.rtl.vectors import run
from splatcore.spec.number import FP24, Float

SMALL = Float(3, 3, subnormal=False)


def pairs(format: Float) -> tuple[np.ndarray, np.ndarray]:
    """Codes that encoding can give: there is one zero."""
    if format is SMALL:
        a, b = (codes.ravel() for codes in np.mgrid[: 1 << format.width, : 1 << format.width])
    else:
        rng = np.random.default_rng(0)
        a = rng.integers(0, 1 << format.width, 100_000)
        near = np.clip(a + rng.integers(-1, 2, a.size), 0, (1 << format.width) - 1)
        b = np.where(rng.random(a.size) < 0.5, near, rng.integers(0, 1 << format.width, a.size))
    return tuple(format.encode(format.decode(codes.astype(np.uint64))) for codes in (a, b))


@pytest.mark.slow
@pytest.mark.parametrize("format", [SMALL, FP24], ids=str)
def test_maximum(format):
    a, b = pairs(format)
    found = run(Maximum(format), {"a": a, "b": b, "enable": 1})["o"]
    expected = format.encode(np.maximum(format.decode(a), format.decode(b)))
    assert (found[1:] == expected[:-1]).all()


@pytest.mark.slow
@pytest.mark.parametrize("format", [SMALL, FP24], ids=str)
def test_clamp(format):
    a, b = pairs(format)
    limit = format.encode(np.abs(format.decode(b)))
    found = run(Clamp(format), {"a": a, "b": limit, "enable": 1})["o"]
    bound = format.decode(limit)
    expected = np.clip(format.decode(a), -bound, bound)
    # a negative number clamped to 0 may come out as the sign alone, which reads as 0
    assert (format.decode(found[1:].astype(a.dtype)) == expected[:-1]).all()


@pytest.mark.slow
def test_enable_holds():
    a = np.arange(16, dtype=np.uint64)
    enable = np.array([1, 0] * 8, np.uint64)
    found = run(Maximum(SMALL), {"a": a, "b": 0, "enable": enable})["o"]
    assert (found[1:] == a[:-1] & ~np.uint64(1)).all()
