"""Clamp and maximum: every pair of codes of a small format, hard pairs of the real one."""

from functools import partial

import numpy as np
import pytest

from splatcore.hdl.arithmetic.minmax import Clamp, Maximum
from splatcore.spec.number import FP24, Float
from tb.helpers.datapaths import Datapath, check, with_pauses

SMALL = Float(3, 3, subnormal=False)


def canonical(format: Float, codes: np.ndarray) -> np.ndarray:
    """Codes that encoding can give: there is one zero."""
    return format.encode(format.decode(codes.astype(np.uint64)))


def maximum(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return format.encode(np.maximum(format.decode(a), format.decode(b)))


def clamp(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A negative number clamped to 0 is the sign alone, which reads as 0."""
    bound, sign = format.decode(b), format.width - 1
    found = format.encode(np.clip(format.decode(a), -bound, bound))
    return found | (a >> sign & 1) << sign


def positive(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The only bounds that there are."""
    return b >> format.width - 1 == 0


@pytest.mark.slow
@pytest.mark.parametrize("format", [SMALL, FP24], ids=str)
def test_equal_golden(format):
    """With pauses, in which the register holds."""
    size, rng = 1 << format.width, np.random.default_rng(0)
    if format is SMALL:
        a, b = (codes.ravel() for codes in np.mgrid[:size, :size])
    else:
        a = rng.integers(0, size, 100_000)
        near = np.clip(a + rng.integers(-1, 2, a.size), 0, size - 1)
        b = np.where(rng.random(a.size) < 0.5, near, rng.integers(0, size, a.size))
        b ^= rng.integers(0, 2, a.size) << format.width - 1
    units = [
        Datapath(Maximum(format), 1, ("a", "b"), partial(maximum, format)),
        Datapath(
            Clamp(format), 1, ("a", "b"), partial(clamp, format), where=partial(positive, format)
        ),
    ]
    inputs = {"a": canonical(format, a), "b": canonical(format, b)}
    check(units, *with_pauses(inputs, rng, 2))
