"""Codes and values of floating-point formats, compiled: the same bits as `spec.number.Float`, for
fractions below 52 bits."""

import numpy as np
from numba import njit

from splatcore.golden.pe import PLACES, rounded, rounding
from splatcore.spec.number import Float, code_dtype

BIAS = 1023  # of float64


def round_values(format: Float, values: np.ndarray) -> np.ndarray:
    """Return the nearest values of the format, float64 [N]."""
    found = np.empty(len(values))
    if _round(np.asarray(values, np.float64), found, rounding(format)):
        return format.round(values)  # for NaN, which the format may refuse
    return found


def encode(format: Float, values: np.ndarray) -> np.ndarray:
    """Return values [N] as codes, rounded to nearest, ties to even."""
    codes = np.empty(len(values), code_dtype(format.width))
    to, shape = rounding(format), (format.exponent, format.fraction, format.bias)
    if _encode(np.asarray(values, np.float64), codes, to, *shape):
        return format.encode(values)
    return codes


def decode(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return the values of codes [N], float64, exact."""
    values, to = np.empty(len(codes)), rounding(format)
    shape = format.exponent, format.fraction, format.bias
    _decode(np.asarray(codes, np.uint64), values, to, *shape, format.subnormal)
    return values


@njit(nogil=True, cache=True)
def _round(values, found, to):
    """Round all values; return whether one is NaN."""
    nan = False
    for k in range(len(values)):
        found[k] = rounded(values[k], to)
        nan |= values[k] != values[k]
    return nan


@njit(nogil=True, cache=True, error_model="numpy")
def _encode(values, codes, to, exponent, fraction, bias):
    """Encode all values; return whether one is NaN, whose code has no meaning."""
    nan, sign = False, np.uint64(1) << np.uint64(exponent + fraction)
    for k in range(len(values)):
        value = rounded(values[k], to)
        size = abs(value)
        if size < to.lowest:
            code = np.int64(size / to.unit)
        elif size == np.inf:
            code = np.int64((1 << exponent) - 1) << fraction
        else:
            bits = np.float64(size).view(np.int64)
            code = (bits >> PLACES - fraction) + (bias - BIAS << fraction)
        nan |= values[k] != values[k]
        negative = to.signed and np.copysign(1.0, value) < 0
        codes[k] = np.uint64(code) | sign if negative else np.uint64(code)
    return nan


@njit(nogil=True, cache=True)
def _decode(codes, values, to, exponent, fraction, bias, subnormal):
    """Decode all codes."""
    ends = (1 << exponent) - 1
    for k in range(len(codes)):
        code = np.int64(codes[k])
        biased, below = code >> fraction & ends, code & (1 << fraction) - 1
        if biased == 0:
            value = below * to.unit if subnormal else 0.0
        elif biased == ends and to.zero_sign:  # a format with infinities
            value = np.nan if below else np.inf
        else:
            bits = (biased + (BIAS - bias) << PLACES) + (below << PLACES - fraction)
            value = np.int64(bits).view(np.float64)
        if to.signed and code >> exponent + fraction:
            value = -value
        values[k] = value if to.zero_sign else value + 0.0
