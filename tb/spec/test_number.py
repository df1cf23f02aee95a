"""Number formats against exact rationals, and against numpy's float16 and float32.

The oracles share no code with `spec.number`: `tb.helpers.exact_floats`.
"""

from fractions import Fraction
from itertools import product
from math import ceil, floor

import numpy as np
import pytest

from splatcore.spec.number import FP16, FP24, Bits, Fixed, Float
from tb.helpers.exact_floats import exact, infinity_code, nearest

pytestmark = pytest.mark.filterwarnings("error", "ignore::amaranth.hdl.UnusedElaboratable")

HUGE = np.finfo(np.float64).max
TINY = 5e-324  # float64's smallest subnormal
EXTREMES = np.array([sign * x for sign in (1, -1) for x in (0, TINY, 2**-1022, 1, HUGE, np.inf)])

FP32 = Float(8, 23, overflow="infinity")
SMALL = [
    Float(exponent, fraction, signed, subnormal, overflow)
    for exponent, fraction in ((2, 1), (2, 3), (3, 2), (4, 1), (5, 3))
    for signed, subnormal in product((True, False), repeat=2)
    for overflow in ("saturate", "infinity")
]
LARGE = [FP24, FP16, FP32, Float(7, 16, signed=False), Float(7, 16, subnormal=False), Float(8, 23)]
LARGE += [Float(10, 52), Float(10, 52, signed=False, subnormal=False, overflow="infinity")]
FIXED = [
    Fixed(integer, fraction, signed, rounding)
    for integer, fraction in (
        *((-3, 8), (0, 6), (4, 3), (8, 8), (8, -4), (12, 8)),
        *((31, 31), (-900, 940), (1000, -960), (53, 0), (62, 0)),
    )
    for signed in (True, False)
    for rounding in ("nearest-even", "floor", "ceiling")
]
EVERY_CODE = [f for f in SMALL + FIXED if f.width <= 20]
EVERY_CODE += [FP16, Float(7, 12), Float(7, 12, signed=False, subnormal=False), Bits(20)]


def anywhere(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return float64 of any sign, exponent and fraction: random bit patterns except NaN."""
    values = rng.integers(0, 1 << 64, count, dtype=np.uint64).view(np.float64)
    return values[~np.isnan(values)]


def around(points: np.ndarray) -> np.ndarray:
    """Return sorted points, the midpoints between them, and the float64 neighbours of both."""
    points = np.concatenate([points, points[:-1] + (points[1:] - points[:-1]) / 2])
    return np.concatenate([points, np.nextafter(points, -HUGE), np.nextafter(points, HUGE)])


def some_codes(rng: np.random.Generator, first: int, end: int, count: int) -> np.ndarray:
    """Return sorted codes of first … end − 1: all if few, else both ends and random neighbours."""
    if end - first <= 4 * count:
        return np.arange(first, end, dtype=np.uint64)
    random = rng.integers(first, end - 1, count, dtype=np.uint64)
    ends = np.arange(8, dtype=np.uint64)
    return np.unique(np.concatenate([random, random + 1, first + ends, end - 1 - ends]))


def float_code(format: Float, value: float) -> int:
    """Return the code nearest to a value (not NaN), ties to even."""
    exact_value = value if np.isinf(value) else Fraction(float(value))
    return nearest(format, exact_value, bool(np.signbit(value)))


def hard_values(format: Float, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return values of codes, ties and their neighbours, values around both ends, random ones."""
    normal = 2**format.fraction
    codes = some_codes(rng, 0, infinity_code(format), count)
    end = min(normal + 8, infinity_code(format))
    codes = np.union1d(codes, some_codes(rng, max(normal - 8, 0), end, 8))
    grid = np.unique([float(exact(format, int(code))) for code in codes])
    largest, smallest = grid[-1], 2.0 ** (1 - format.bias)
    step = largest - grid[-2]
    ends = np.concatenate([largest + step * np.array([0.5, 1, 2]), smallest * np.array([0.5, 0.7])])
    values = np.concatenate([around(grid), around(np.sort(ends))])
    return np.concatenate([values, -values, EXTREMES, anywhere(rng, count)])


@pytest.mark.parametrize("format", SMALL + LARGE, ids=str)
def test_float_encode(format):
    """Encoding gives the nearest code, by rationals. (FP16 and FP32 here also check numpy's.)"""
    values = hard_values(format, np.random.default_rng(1), 100)
    expected = np.array([float_code(format, value) for value in values], np.uint64)
    codes = format.encode(values)
    np.testing.assert_array_equal(codes, expected)


@pytest.mark.parametrize("format", SMALL + LARGE, ids=str)
def test_float_decode(format):
    """Values of finite codes, with and without sign; infinity and NaN above them."""
    codes = some_codes(np.random.default_rng(2), 0, infinity_code(format), 300)
    expected = np.array([float(exact(format, int(code))) for code in codes])
    np.testing.assert_array_equal(format.decode(codes), expected)
    assert not np.signbit(format.decode(codes)).any()
    if format.signed:
        sign = np.uint64(1 << (format.width - 1))
        values = format.decode(codes | sign)
        np.testing.assert_array_equal(values, -expected)
        kept = (expected > 0) | (format.overflow == "infinity")
        np.testing.assert_array_equal(np.signbit(values), kept)
    if format.overflow == "infinity":
        infinity = infinity_code(format)
        nan = some_codes(np.random.default_rng(3), infinity + 1, infinity + 2**format.fraction, 9)
        assert format.decode(infinity) == np.inf
        assert np.isnan(format.decode(nan)).all()


@pytest.mark.parametrize(("ieee", "format"), [(np.float16, FP16), (np.float32, FP32)], ids=str)
def test_float_is_ieee(ieee, format):
    """Over a million values, and all codes of float16 (a sample of float32's), as in numpy."""
    rng, unsigned = np.random.default_rng(4), np.dtype(f"u{format.width // 8}")
    codes = np.arange(2**16) if format is FP16 else rng.integers(0, 2**32, 2**18)
    codes = codes.astype(unsigned)
    with np.errstate(invalid="ignore"):  # numpy's conversion of signalling NaN
        real = codes.view(ieee).astype(np.float64)
    np.testing.assert_array_equal(format.decode(codes), real)
    known = ~np.isnan(real)
    signs = np.signbit(format.decode(codes[known]))
    np.testing.assert_array_equal(signs, np.signbit(real[known]))

    finite = np.unique(real[np.isfinite(real)])
    parts = [
        around(finite),  # every tie of float16 and its neighbours
        rng.uniform(-1, 1, 2**18) * format.min_normal,
        rng.uniform(0.999, 1.001, 2**18) * format.max,
        np.exp2(rng.uniform(-155, 135, 2**18)) * rng.choice([-1, 1], 2**18),
        anywhere(rng, 2**18),
        np.concatenate([EXTREMES, [np.nan]]),
    ]
    values = np.concatenate(parts)
    assert len(values) > 1_000_000
    with np.errstate(over="ignore", under="ignore"):
        expected = values.astype(ieee).view(unsigned)
    np.testing.assert_array_equal(format.encode(values), expected)


def test_float_nan():
    """Every NaN becomes one code, whatever its sign and payload, signed or not."""
    nans = np.array([0x7FF8 << 48, 0xFFF8 << 48, (0x7FF0 << 48) + 1], np.uint64).view(np.float64)
    np.testing.assert_array_equal(FP16.encode(nans), 0x7E00)
    np.testing.assert_array_equal(Float(5, 10, False, overflow="infinity").encode(nans), 0x7E00)


@pytest.mark.parametrize("format", SMALL + LARGE, ids=str)
def test_float_codes_rise(format):
    """Codes of values ≥ 0 have the order of the values, with infinity last."""
    values = hard_values(format, np.random.default_rng(5), 5000)
    codes = format.encode(np.sort(np.abs(values)))
    assert (codes[1:] >= codes[:-1]).all() and codes[0] == 0
    assert (np.diff(format.decode(np.unique(codes))[:-1]) > 0).all()


@pytest.mark.parametrize("format", SMALL + LARGE, ids=str)
def test_float_properties(format):
    finite = infinity_code(format) - 1
    normal = 2**format.fraction
    assert format.bias == 2 ** (format.exponent - 1) - 1
    assert format.width == format.signed + format.exponent + format.fraction
    assert format.max == exact(format, finite)
    assert format.min_normal == exact(format, normal)
    assert format.min_subnormal == exact(format, 1 if format.subnormal else normal)
    values = np.abs(hard_values(format, np.random.default_rng(6), 50))
    values = values[(values >= format.min_normal) & (values <= format.max)]
    for value, rounded in zip(values, format.round(values), strict=True):
        error = abs(Fraction(float(value)) - Fraction(float(rounded)))
        assert error <= Fraction(format.epsilon) * Fraction(float(value))
    assert 1 + 2 * format.epsilon == exact(format, format.bias * normal + 1)


@pytest.mark.parametrize("format", FIXED, ids=str)
def test_fixed(format):
    """Encoding rounds value / step, by rationals, and saturates; decoding multiplies by step."""
    rounding = {"nearest-even": round, "floor": floor, "ceiling": ceil}[format.rounding]
    low = -(2 ** (format.width - 1)) if format.signed else 0
    high = low + 2**format.width - 1
    rng = np.random.default_rng(7)
    codes = some_codes(rng, 0, 2**format.width, 100)
    steps = [int(code) - (2**format.width if code > high else 0) for code in codes]
    step = Fraction(2) ** -format.fraction
    np.testing.assert_array_equal(format.decode(codes), [float(k * step) for k in steps])
    assert (format.min, format.max) == (float(low * step), float(high * step))
    assert format.step == step

    grid = np.unique([float(k * step) for k in [*steps, low - 1, high + 1]])
    near = rng.uniform(-20, 20, 200) * format.step  # float64 is much finer than the format
    values = np.concatenate([around(grid), -grid, near, EXTREMES, anywhere(rng, 200)])
    values[np.isinf(values)] = 0
    expected = [min(max(rounding(Fraction(float(v)) / step), low), high) for v in values]
    expected = np.array([k % 2**format.width for k in expected], np.uint64)
    np.testing.assert_array_equal(format.encode(values), expected)
    ends = np.array([low % 2**format.width, high], np.uint64)
    np.testing.assert_array_equal(format.encode([-np.inf, np.inf]), ends)


@pytest.mark.parametrize("format", EVERY_CODE, ids=str)
def test_every_code_returns(format):
    """encode(decode(code)) is the code itself, except for the other codes of zero and NaN."""
    codes = np.arange(2**format.width)
    values = format.decode(codes)
    expected = codes.copy()
    if isinstance(format, Float):
        sign = codes & format.signed << (format.exponent + format.fraction)
        zero = sign if format.overflow == "infinity" else 0
        expected = np.where(values == 0, zero, expected)
        nan = infinity_code(format) + 2 ** (format.fraction - 1)
        expected = np.where(np.isnan(values), nan, expected)
    np.testing.assert_array_equal(format.encode(values), expected)
    np.testing.assert_array_equal(format.round(values), values)


@pytest.mark.parametrize("format", [FP16, FP24, Fixed(4, 4), Fixed(4, 20, True), Bits(9)], ids=str)
def test_shapes(format):
    """The result has the input's shape, even if scalar or empty; the input is unchanged."""
    for shape in ((), (0,), (3,), (2, 0), (2, 3, 4)):
        values = np.ones(shape, np.int64 if isinstance(format, Bits) else np.float64)
        for result in (format.encode(values), format.round(values)):
            assert result.shape == shape
        assert (values == 1).all()


def test_code_dtypes():
    """Codes have the smallest unsigned dtype that holds the width."""
    for width in range(1, 65):
        dtype = np.dtype(f"u{1 if width <= 8 else 2 if width <= 16 else 4 if width <= 32 else 8}")
        assert Bits(width).encode([0, 1]).dtype == dtype
        if width < 64:
            assert Fixed(width, 0).encode([0.0]).dtype == dtype
        if 6 <= width < 56:
            assert Float(4, width - 4, signed=False).encode([0.0]).dtype == dtype


def test_formats_are_values():
    """Formats are equal by content and usable as keys, which the hardware's layouts need."""
    same = Float(7, 16, subnormal=False)
    assert same == FP24 and hash(same) == hash(FP24)
    assert len({Fixed(4, 4), Fixed(4, 4), Fixed(4, 4, rounding="floor"), Bits(8), FP16, FP24}) == 5


@pytest.mark.parametrize("format", [FP24, Float(4, 3, signed=False), Fixed(4, 4)], ids=str)
def test_nan_is_refused(format):
    with pytest.raises(ValueError, match="NaN"):
        format.encode([0.0, np.nan])


@pytest.mark.parametrize("format", [FP24, Fixed(3, 4, True), Bits(5)], ids=str)
def test_odd_codes_are_refused(format):
    method = format.encode if isinstance(format, Bits) else format.decode
    for odd in ([0, -1], [1 << format.width], [2**64 - 1], np.array([-1], np.int8)):
        with pytest.raises(ValueError, match=f"does not fit in {format.width} bits"):
            method(odd)
    with pytest.raises(TypeError, match="integers"):
        method([1.0])


@pytest.mark.parametrize(
    "make",
    [
        *(lambda w=w: Bits(w) for w in (0, 65)),
        *(lambda i=i, f=f: Fixed(i, f) for i, f in ((0, 0), (32, 32), (-4, 3), (1024, -1000))),
        lambda: Fixed(32, 31, signed=True),
        lambda: Fixed(-1020, 1023),
        lambda: Fixed(4, 4, rounding="up"),
        *(lambda e=e, f=f: Float(e, f) for e, f in ((1, 4), (11, 4), (5, 0), (5, 53))),
        lambda: Float(5, 10, overflow="wrap"),
    ],
)
def test_impossible_formats_are_refused(make):
    with pytest.raises(ValueError):
        make()
