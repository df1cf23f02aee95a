"""Golden model of reciprocal and reciprocal square root: the integers of `spec.unary`, on arrays.

Inputs are codes [...] of a `Float`, results codes [...] of the same format in its unsigned dtype.
"""

import numpy as np

from splatcore.spec import unary
from splatcore.spec.number import Float, checked_codes, code_dtype
from splatcore.spec.unary import Datapath, Function, exponent_max


def reciprocal(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return codes [...] of 1/x, from codes [...] of x."""
    return _unary("reciprocal", format, codes)


def rsqrt(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return codes [...] of 1/√x, from codes [...] of x."""
    return _unary("rsqrt", format, codes)


def _unary(function: Function, format: Float, codes: np.ndarray) -> np.ndarray:
    """Compute results as if the range had no end, then clamp them, then set special values."""
    path = unary.datapath(function, format.fraction)
    codes = checked_codes(codes, format.width, str(format)).astype(np.int64)
    shape, codes = codes.shape, codes.ravel()
    fraction, biased = _normalised(format, codes)
    exponent = unary.result_exponent(function, format, biased)
    total = _interpolated(path, fraction, (biased & 1) ^ 1)  # the bias is odd
    magnitude = _packed(format, path, total, exponent)
    results = _with_special(function, format, codes, magnitude)
    return results.astype(code_dtype(format.width)).reshape(shape)


def _normalised(format: Float, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the fraction below the leading one, and the biased exponent that goes with it."""
    fraction = codes & (1 << format.fraction) - 1
    biased = codes >> format.fraction & (1 << format.exponent) - 1
    if format.subnormal:
        small = np.flatnonzero(biased == 0)
        steps = fraction[small]
        _, length = np.frexp(steps.astype(np.float64))  # exact: the number of significant bits
        places = np.minimum(format.fraction + 1 - length, format.fraction)
        fraction[small] = steps << places & (1 << format.fraction) - 1
        biased[small] = 1 - places
    return fraction, biased


def _interpolated(path: Datapath, fraction: np.ndarray, parity: np.ndarray) -> np.ndarray:
    """Return the sum of the three terms for a fraction and, for rsqrt, a parity."""
    table = unary.coefficients(path)
    address = fraction >> path.rest
    if path.function == "rsqrt":
        address = address | parity << path.index
    total = np.array(table.offset)[address] << path.point - path.guard
    if path.degree >= 1:
        below = ~fraction & (1 << path.rest) - 1
        total += np.array(table.slope)[address] * below
    if path.degree >= 2:
        half = 1 << path.rest - 1
        distance = np.where(fraction & half, fraction, ~fraction) & half - 1
        a = distance >> path.reach_drop
        square = a * (a + 1) >> path.square_drop
        total += np.array(table.curve)[address] * square << path.curve_shift
    return total & (2 << path.fraction + path.point) - 1


def _packed(format: Float, path: Datapath, total: np.ndarray, exponent: np.ndarray) -> np.ndarray:
    """Return codes without sign of (1 + total · 2^−(point + fraction)) · 2^exponent, rounded."""
    finite = np.clip(exponent, 1, exponent_max(format) + 1)  # beyond, any code that is too large
    codes = (finite << format.fraction) + (total >> path.point)
    if format.subnormal:
        small = np.flatnonzero(exponent < 1)
        places = np.minimum(1 - exponent[small], format.fraction + 3)
        one = 1 << format.fraction + path.point
        half_units = (1 << places) - 1 << path.point - 1
        codes[small] = one + total[small] + half_units >> path.point + places
    else:
        codes[exponent == 0] = 1 << format.fraction
        codes[exponent < 0] = 0  # a power of two may be half of `min_normal`: the even code is 0
    infinite = exponent_max(format) + 1 << format.fraction
    return np.minimum(codes, infinite - (format.overflow == "saturate"))


def _with_special(
    function: Function, format: Float, codes: np.ndarray, magnitude: np.ndarray
) -> np.ndarray:
    """Return codes with sign; set zeros, negative inputs of rsqrt, infinities and NaN."""
    saturate = format.overflow == "saturate"
    sign_bit = format.width - 1
    unsigned = codes & (1 << format.exponent + format.fraction) - 1
    sign = codes >> sign_bit if format.signed else np.zeros_like(codes)
    infinite = exponent_max(format) + 1 << format.fraction
    zero = unsigned < (1 if format.subnormal else 1 << format.fraction)
    magnitude = np.where(zero, infinite - saturate, magnitude)
    if not saturate:
        magnitude = np.where(unsigned == infinite, 0, magnitude)
    nan = unsigned > infinite
    if function == "rsqrt":
        if saturate:
            magnitude = np.where(sign == 1, infinite - 1, magnitude)
        nan = nan | (sign == 1) & ~zero & (not saturate)
        sign = sign & zero & (not saturate)
    if saturate:
        sign = sign & (magnitude != 0)
        nan = np.zeros_like(nan)
    signed = magnitude | sign << sign_bit
    return np.where(nan, infinite | 1 << format.fraction - 1, signed)
