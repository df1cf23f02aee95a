"""Reciprocal and rsqrt: golden model against integers and rationals, RTL against golden model.

Bounds are checked as integer inequalities. With x = X·2^a and a result R·2^b of last place 2^b:

    |R·2^b − 1/x| ≤ n/d · 2^b    ⇔    (dR − n)·X ≤ d·2^(−a−b) ≤ (dR + n)·X
    |R·2^b − 1/√x| ≤ n/d · 2^b   ⇔    (dR − n)²·X ≤ d²·2^(−a−2b) ≤ (dR + n)²·X     (dR ≥ n)
"""

from fractions import Fraction
from functools import partial
from itertools import product

import numpy as np
import pytest

from splatcore.golden.unary import reciprocal, rsqrt
from splatcore.hdl.arithmetic.unary import REGISTERS, Reciprocal, Rsqrt
from splatcore.spec.number import FP16, Float
from tb.helpers.datapaths import Datapath, check, with_pauses

FUNCTIONS = (reciprocal, rsqrt)
UNITS = {Reciprocal: reciprocal, Rsqrt: rsqrt}

GRADUAL24 = Float(7, 16)
NORMAL24 = Float(7, 16, subnormal=False)
SMALL = [
    Float(exponent, fraction, signed, subnormal, overflow)
    for exponent, fraction in ((2, 3), (3, 4), (4, 3), (3, 7), (5, 3))
    for signed, subnormal in product((True, False), repeat=2)
    for overflow in ("saturate", "infinity")
]
EVERY_CODE = [
    FP16,
    Float(5, 10),
    Float(5, 10, signed=False, subnormal=False, overflow="infinity"),
    Float(7, 8),
    Float(4, 11, subnormal=False),
    Float(7, 12),
    Float(6, 13, overflow="infinity"),
]
IN_RTL = [
    *EVERY_CODE[:5],
    *(Float(2, 3), Float(3, 4, signed=False), Float(3, 6, subnormal=False, overflow="infinity")),
    Float(4, 9, overflow="infinity"),
]


def fields(format: Float, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sign, integer significand and its exponent; zeros have significand 0."""
    codes = np.asarray(codes).astype(np.int64)
    biased, fraction = np.divmod(codes % 2 ** (format.width - format.signed), 2**format.fraction)
    significand = np.where(biased > 0, 2**format.fraction + fraction, fraction * format.subnormal)
    sign = (codes >> format.width - 1) * format.signed
    return sign, significand, np.maximum(biased, 1) - format.bias - format.fraction


def top(format: Float) -> int:
    """Return the code of an overflow, without sign; infinity counts as the next value."""
    infinity = format.overflow == "infinity"
    return (2**format.exponent - infinity) * 2**format.fraction - (not infinity)


def assert_close(function, format: Float, codes: np.ndarray, bound=(3, 4)) -> None:
    """Check |error| ≤ `bound` units in the result's last place, for finite x > 0 and at least 4
    exponent bits; between 0 and `min_normal`, check for the exact neighbour."""
    results = function(format, codes).astype(np.int64)
    _, x, a = fields(format, codes)
    assert (x > 0).all()
    if function is reciprocal and not format.subnormal:
        ends = (2**format.bias, 2 ** (format.bias - 1))  # with result 0, min_normal
        gone, least = (codes >= format.encode(float(end)) for end in ends)
        np.testing.assert_array_equal(results[gone], 0)
        np.testing.assert_array_equal(results[~gone & least], 1 << format.fraction)
        results, x, a = (v[~least] for v in (results, x, a))
    _, r, b = fields(format, results)
    assert (r > 0).all() and (results <= top(format)).all()
    wide = format.fraction > 18
    if wide:  # products of more than 63 bits
        x, r = x.astype(object), r.astype(object)
    n, d = bound
    low, exact, high, scale = (d * r - n) * x, -a - b, (d * r + n) * x, d
    if function is rsqrt:
        low, exact, high, scale = (d * r - n) ** 2 * x, exact - b, (d * r + n) ** 2 * x, d**2
    large = results == top(format)
    limit = 100 if wide else 57
    exact = np.where(large, np.minimum(exact, limit), exact)
    assert (exact >= 0).all() and (exact <= limit).all()
    exact = scale * np.left_shift(np.ones_like(x), exact)
    assert (low <= exact).all()
    assert (exact <= high)[~large].all()


def positive(format: Float) -> np.ndarray:
    """Return the codes of all finite values above zero."""
    first = 1 if format.subnormal else 2**format.fraction
    return np.arange(first, top(format) + (format.overflow == "saturate"))


def hard_codes(format: Float, count: int) -> np.ndarray:
    """Return positive finite codes: all fractions at both parities, binades' ends, random ones."""
    size = 1 << format.fraction
    last = positive(format)[-1] if format.width < 28 else top(format) - 1
    middle = format.bias * size + np.arange(-min(size, 2**16), min(2 * size, 2**17))
    ends = (np.arange(2**format.exponent)[:, None] * size + np.arange(-4, 5)).ravel()
    powers = 1 << np.arange(format.fraction + 1)
    tiny = (powers[:, None] + np.arange(-2, 3)).ravel()  # subnormal values of each length
    random = np.random.default_rng(1).integers(0, last, count)
    codes = np.concatenate([middle, ends, tiny, random])
    return codes[(codes >= (1 if format.subnormal else size)) & (codes <= last)]


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("format", EVERY_CODE, ids=str)
def test_error_every_code(format, function):
    assert_close(function, format, positive(format))


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("format", [GRADUAL24, NORMAL24, Float(8, 17), Float(6, 18)], ids=str)
def test_error(format, function):
    assert_close(function, format, hard_codes(format, 1_000_000))


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("fraction", [19, 20, 21, 22, 23])
@pytest.mark.slow
def test_error_wide(fraction, function):
    """Fractions as long as binary32's, with a bound of ⅘."""
    format = Float(8, fraction, overflow="infinity")
    assert_close(function, format, hard_codes(format, 20_000)[::7], bound=(4, 5))


def allowed(function, format: Float, code: int, result: int) -> bool:
    """Return whether an input may have this result, by rationals and the format's definition."""
    (sign, sign_out), (x, r), (a, b) = (v.tolist() for v in fields(format, [code, result]))
    magnitude, magnitude_out = (c % 2 ** (format.width - format.signed) for c in (code, result))
    infinity = top(format)
    ieee, root = format.overflow == "infinity", function is rsqrt
    if ieee and (magnitude > infinity or (root and sign and x)):
        return result == infinity + 2 ** (format.fraction - 1)
    # A root has a sign only for −0; zero has no sign if it has a single code.
    if sign_out != (sign and (ieee or (magnitude_out > 0 and not root))):
        return False
    if x == 0 or (root and sign):
        return magnitude_out == infinity
    if ieee and magnitude == infinity:
        return magnitude_out == 0
    reach = Fraction(3, 4) * Fraction(2) ** b
    low, high = r * Fraction(2) ** b - reach, r * Fraction(2) ** b + reach
    half = Fraction(2) ** -format.bias  # of `min_normal`
    if not format.subnormal and r == 0:
        low, high = Fraction(0), half
    elif not format.subnormal and magnitude_out == 2**format.fraction:
        low = half
    if root:
        low, high = max(low, 0) ** 2, high**2
    exact = 1 / (x * Fraction(2) ** a)
    if (r == 0 and magnitude_out != 0) or magnitude_out > infinity:
        return False
    return low <= exact and (exact <= high or magnitude_out == infinity)


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("format", SMALL, ids=str)
def test_small(format, function):
    """All codes, special ones included, of formats whose results underflow and overflow."""
    codes = range(2**format.width)
    results = function(format, np.arange(2**format.width)).tolist()
    wrong = [c for c, r in zip(codes, results, strict=True) if not allowed(function, format, c, r)]
    assert not wrong, [(c, results[c]) for c in wrong[:8]]


@pytest.mark.parametrize(
    "format", [*EVERY_CODE, GRADUAL24, NORMAL24, Float(7, 15), Float(8, 23)], ids=str
)
def test_powers_are_exact(format):
    """1/2^n and 1/√(4^n) are exact; at the ends of the range, results are as in `Float.encode`."""
    least, largest = np.log2([format.min_subnormal, format.max]).astype(int)
    powers = np.ldexp(1.0, np.arange(least, largest + 1))
    fours = powers[np.arange(least, largest + 1) % 2 == 0]
    for function, given, right in (
        (reciprocal, powers, 1 / powers),
        (rsqrt, fours, 1 / np.sqrt(fours)),
    ):
        found = function(format, format.encode(given))
        np.testing.assert_array_equal(found, format.encode(right))


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("format", [*EVERY_CODE, GRADUAL24, NORMAL24], ids=str)
@pytest.mark.slow
def test_monotone(format, function):
    """Over zero and every finite positive code."""
    results = function(format, np.append(0, positive(format))).astype(np.int32)
    assert (results[1:] <= results[:-1]).all()
    if format.signed and function is reciprocal:  # odd, except for the single zero
        sign = 1 << format.width - 1
        some = positive(format)[::97]
        negative = results[1::97] + sign * ((results[1::97] > 0) | (format.overflow == "infinity"))
        np.testing.assert_array_equal(function(format, some | sign), negative)


def test_special_values():
    """The table of `spec.unary`, in codes of binary16 and of a saturating format."""
    infinity, nan, minus = 0x7C00, 0x7E00, 0x8000
    codes = [0, minus, infinity, minus + infinity, 0x7C01, 0xFFFF, 0xBC00, 0x0001, 0x8001]
    both = [infinity, minus + infinity]
    assert reciprocal(FP16, codes).tolist() == [*both, 0, minus, nan, nan, 0xBC00, *both]
    assert rsqrt(FP16, codes).tolist() == [*both, 0, nan, nan, nan, nan, 0x6C00, nan]
    minus, one, largest = 1 << 23, 63 << 16, (1 << 23) - 1
    codes = [0, minus, 1, minus + 1, one, minus + one, largest, minus + largest]
    ends = [largest, minus + largest] * 2
    units = [one, minus + one]
    tail = [0x2000, minus + 0x2000]  # 2^−65, in steps of 2^−78
    assert reciprocal(GRADUAL24, codes).tolist() == [*ends, *units, *tail]
    assert reciprocal(NORMAL24, codes).tolist() == [*ends, *units, 0, 0]
    small, large = [0x1FFF, 0x2000, 0x4000], [largest, largest, 127 << 16]  # 2^−65, 2^−64
    assert reciprocal(GRADUAL24, small).tolist() == large
    least = (30 << 16) + 27146  # 1/√(2^65)
    root = [largest, largest, largest, largest, one, largest, least, largest]
    assert rsqrt(NORMAL24, codes).tolist() == root
    root[2] = 102 << 16  # 1/√(2^−78)
    assert rsqrt(GRADUAL24, codes).tolist() == root


def test_shapes():
    """Results keep the shape, in the format's dtype; codes that do not fit are refused."""
    for function in FUNCTIONS:
        for shape in ((), (0,), (2, 0), (2, 3)):
            codes = np.full(shape, 0x3C01, np.uint16)
            results = function(FP16, codes)
            assert results.shape == shape and results.dtype == np.uint16
            assert (codes == 0x3C01).all()
        with pytest.raises(ValueError, match="16 bits"):
            function(FP16, [1 << 16])
        for fraction in (2, 24):
            with pytest.raises(ValueError, match="3 … 23"):
                function(Float(5, fraction), [0])
    with pytest.raises(ValueError, match="negative"):
        Reciprocal(FP16, -1)


def unit(make: type, format: Float, latency: int) -> Datapath:
    return Datapath(make(format, latency), latency, ("a",), partial(UNITS[make], format))


def check_rtl(units: list[Datapath], codes: np.ndarray) -> None:
    """Check units against their golden models: codes in random order, with noise in pauses."""
    rng = np.random.default_rng(2)
    latest = max(unit.latency for unit in units)
    check(units, *with_pauses({"a": rng.permutation(codes)}, rng, latest))


@pytest.mark.slow
def test_rtl_every_code():
    """All codes of formats of each kind and degree, at every latency."""
    assert len(IN_RTL) > len(REGISTERS) + 2
    formats = enumerate(IN_RTL)
    check_rtl([unit(make, format, k) for k, format in formats for make in UNITS], np.arange(2**16))


@pytest.mark.slow
def test_rtl_24_bits():
    """Every significand at both parities, ends of every binade, random codes; with signs."""
    latencies = ((Reciprocal, 0, 4), (Rsqrt, 3, 5))
    units = [
        unit(make, format, latency)
        for make, *both in latencies
        for format, latency in zip((GRADUAL24, NORMAL24), both, strict=True)
    ]
    codes = hard_codes(GRADUAL24, 200_000)
    signed = np.append(codes, codes[::3] | 1 << 23)
    check_rtl(units, np.append(signed, [0, 1 << 23]))
