"""Codes and values of floating-point formats, in C++ (`pe.cpp`): the same bits as
`spec.number.Float`."""

import numpy as np

from splatcore.golden.pe import FORMAT, LIBRARY, constants
from splatcore.spec.number import Float, code_dtype

_round = LIBRARY.function("round_values", int, np.float64, np.float64, FORMAT, result=int)
_encode = LIBRARY.function("encode", int, np.float64, None, int, FORMAT, result=int)
_decode = LIBRARY.function("decode", int, None, int, np.float64, FORMAT)


def round_values(format: Float, values: np.ndarray) -> np.ndarray:
    """Return the nearest values of the format, float64 [N]."""
    values, found = np.ascontiguousarray(values, np.float64), np.empty(len(values))
    if _round(len(values), values, found, constants(format)):
        return format.round(values)  # for NaN, which the format may refuse
    return found


def encode(format: Float, values: np.ndarray) -> np.ndarray:
    """Return values [N] as codes, rounded to nearest, ties to even."""
    values = np.ascontiguousarray(values, np.float64)
    codes = np.empty(len(values), code_dtype(format.width))
    if _encode(len(values), values, codes, codes.itemsize, constants(format)):
        return format.encode(values)
    return codes


def decode(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return the values of codes [N], float64, exact."""
    codes, values = np.ascontiguousarray(codes), np.empty(len(codes))
    _decode(len(codes), codes, codes.itemsize, values, constants(format))
    return values
