"""The golden float arithmetic, bit for bit, against numpy's float16 and exact rationals."""

from fractions import Fraction
from functools import partial
from math import ceil, floor, inf

import numpy as np
import pytest

from splatcore.golden import arithmetic
from splatcore.spec.number import FP16, FP24, Fixed, Float
from tb.helpers.exact_floats import exact, is_negative, nearest
from tb.helpers.float_pairs import corners, every_pair, pairs

pytestmark = pytest.mark.filterwarnings("error", "ignore::amaranth.hdl.UnusedElaboratable")

GRADUAL = Float(7, 16)
SMALL = [Float(3, 2), Float(2, 3), Float(3, 2, signed=False), Float(3, 2, subnormal=False)]
SMALL += [Float(3, 2, overflow="infinity"), Float(2, 2, subnormal=False, overflow="infinity")]
LARGE = [FP24, GRADUAL, Float(8, 23), Float(5, 24, overflow="infinity"), Float(10, 24)]

MILLION = 1_000_000


def exact_product(format: Float, a: int, b: int) -> int:
    x, y = exact(format, a), exact(format, b)
    negative = is_negative(format, a) != is_negative(format, b)
    if x is None or y is None or (inf in (abs(x), abs(y)) and 0 in (x, y)):
        return nearest(format, None, False)
    if inf in (abs(x), abs(y)):
        return nearest(format, -inf if negative else inf, negative)
    return nearest(format, x * y, negative)


def exact_sum(format: Float, a: int, b: int) -> int:
    x, y = exact(format, a), exact(format, b)
    if x is None or y is None or (abs(x) == abs(y) == inf and x != y):
        return nearest(format, None, False)
    value = x if abs(x) == inf else y if abs(y) == inf else x + y
    return nearest(format, value, is_negative(format, a) and is_negative(format, b))


def float16(operation, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the codes of numpy's result, with one code for all NaN."""
    with np.errstate(all="ignore"):
        value = operation(a.view(np.float16), b.view(np.float16))
    return np.where(np.isnan(value), 0x7E00, value.view(np.uint16))


@pytest.mark.parametrize("operation", ["multiply", "add"])
def test_float16(operation):
    a, b = pairs(FP16, np.random.default_rng(1), MILLION)
    expected = float16(getattr(np, operation), a, b)
    np.testing.assert_array_equal(getattr(arithmetic, operation)(FP16, a, b), expected)


def test_float16_multiply_add():
    a, b = pairs(FP16, np.random.default_rng(2), MILLION // 4)
    c = np.random.default_rng(3).permutation(b)
    expected = float16(np.add, float16(np.multiply, a, b), c)
    np.testing.assert_array_equal(arithmetic.multiply_add(FP16, a, b, c), expected)


def test_float16_compare():
    a, b = pairs(FP16, np.random.default_rng(4), MILLION // 4)
    less, equal = arithmetic.compare(FP16, a, b)
    np.testing.assert_array_equal(less, a.view(np.float16) < b.view(np.float16))
    np.testing.assert_array_equal(equal, a.view(np.float16) == b.view(np.float16))


@pytest.mark.parametrize("format", SMALL + LARGE, ids=str)
@pytest.mark.slow
def test_exact(format):
    """Products, sums and order, by rationals: all pairs of small formats, hard ones of large."""
    small = format in SMALL
    a, b = every_pair(format.width) if small else pairs(format, np.random.default_rng(5), 20_000)
    codes = list(zip(a.tolist(), b.tolist(), strict=True))
    expected = [exact_product(format, x, y) for x, y in codes]
    np.testing.assert_array_equal(arithmetic.multiply(format, a, b), expected)
    expected = [exact_sum(format, x, y) for x, y in codes]
    np.testing.assert_array_equal(arithmetic.add(format, a, b), expected)

    values = [(exact(format, x), exact(format, y)) for x, y in codes]
    less, equal = arithmetic.compare(format, a, b)
    np.testing.assert_array_equal(less, [None not in pair and pair[0] < pair[1] for pair in values])
    same = [None not in pair and pair[0] == pair[1] for pair in values]
    np.testing.assert_array_equal(equal, same)


def test_multiply_add_rounds_twice():
    """(1 + ε)² − 1: the square loses ε² before the subtraction; a fused operation would keep it."""
    one = FP24.encode(1.0)
    above = one + np.uint32(1)
    expected = FP24.encode(2.0**-15)
    assert arithmetic.multiply_add(FP24, above, above, FP24.encode(-1.0)) == expected


CONVERSIONS = [
    (source, target)
    for source in (FP16, Float(5, 10), Float(4, 3, signed=False), Float(4, 3, subnormal=False))
    for target in (FP16, FP24, GRADUAL, Float(3, 2), Float(4, 6, signed=False, subnormal=False))
]


@pytest.mark.parametrize(("source", "target"), CONVERSIONS, ids=str)
def test_convert(source, target):
    codes = np.unique(np.concatenate([corners(source), np.arange(0, 1 << source.width, 37)]))
    values = [exact(source, int(code)) for code in codes]
    if target.overflow == "saturate":
        values = [Fraction(0) if value is None else value for value in values]
    signs = codes >> (source.width - 1) if source.overflow == "infinity" else 0 * codes
    expected = list(map(partial(nearest, target), values, signs.tolist()))
    np.testing.assert_array_equal(arithmetic.convert(source, target, codes), expected)


FIXED = [
    Fixed(integer, fraction, signed, rounding)
    for integer, fraction in ((8, 2), (-3, 12), (20, -9), (0, 1), (11, 20))
    for signed in (True, False)
    for rounding in ("nearest-even", "floor", "ceiling")
]


@pytest.mark.parametrize("fixed", FIXED, ids=str)
def test_fixed(fixed):
    """Conversion to and from fixed point, against rationals."""
    step = Fraction(2) ** -fixed.fraction
    low = -(2 ** (fixed.width - 1)) if fixed.signed else 0
    high = low + 2**fixed.width - 1
    codes = np.unique(np.random.default_rng(6).integers(0, 1 << fixed.width, 500))
    steps = [int(code) - (2**fixed.width if code > high else 0) for code in codes]
    for format in (FP16, FP24, Float(4, 3, signed=False), Float(4, 3, subnormal=False)):
        expected = [nearest(format, k * step, False) for k in steps]
        np.testing.assert_array_equal(arithmetic.from_fixed(fixed, format, codes), expected)

        floats = np.unique(
            np.concatenate([corners(format), pairs(format, np.random.default_rng(7), 500)[0]])
        )
        expected = []
        for code in floats.tolist():
            value = exact(format, code)
            if value is None:
                expected.append(0)
            elif abs(value) == inf:
                expected.append((high if value > 0 else low) % 2**fixed.width)
            else:
                rounding = {"nearest-even": round, "floor": floor, "ceiling": ceil}[fixed.rounding]
                expected.append(min(max(rounding(value / step), low), high) % 2**fixed.width)
        np.testing.assert_array_equal(arithmetic.to_fixed(format, fixed, floats), expected)


def test_pairs_are_hard():
    """The generated pairs contain cancellation, underflow, overflow, ties and zero sums."""
    a, b = pairs(FP24, np.random.default_rng(8), 80_000)
    x, y = FP24.decode(a), FP24.decode(b)
    product, total = x * y, x + y
    with np.errstate(divide="ignore", invalid="ignore"):
        lost = np.log2(np.abs(x) / np.abs(total))
    below = np.abs(product) < FP24.min_normal
    ties = [np.ldexp(np.frexp(value)[0], 18) % 2 == 1 for value in (product, total)]
    for hard in (lost > 10, below & (product != 0), np.abs(product) > FP24.max, *ties, total == 0):
        assert np.mean(hard) > 0.005


@pytest.mark.parametrize("operation", [arithmetic.multiply, arithmetic.add])
def test_wide_formats_are_refused(operation):
    with pytest.raises(ValueError, match="rounded twice"):
        operation(Float(8, 25), [0], [0])


def test_wide_fixed_is_refused():
    with pytest.raises(ValueError, match="would round"):
        arithmetic.from_fixed(Fixed(30, 24), FP24, [0])


@pytest.mark.parametrize("format", [FP16, FP24, Float(4, 3)], ids=str)
def test_dtypes_and_shapes(format):
    dtype = format.encode(0.0).dtype
    for shape in ((), (3,), (2, 0)):
        codes = np.zeros(shape, dtype)
        for result in (
            arithmetic.multiply(format, codes, codes),
            arithmetic.multiply_add(format, codes, codes, codes),
            arithmetic.convert(FP16, format, codes.astype(np.uint16)),
        ):
            assert result.shape == shape and result.dtype == dtype
