"""Golden model of reciprocal and reciprocal square root: the integers of `spec.unary`, in C++
(`pe.cpp`).
"""

from functools import cache

import numpy as np

from splatcore.golden.codes import decode, encode
from splatcore.golden.pe import FORMAT, LIBRARY, PATH, constants
from splatcore.spec import unary
from splatcore.spec.number import Float, checked_codes, code_dtype
from splatcore.spec.unary import Function

_codes, _values = (
    LIBRARY.function(name, int, kind, kind, FORMAT, PATH, np.int64, np.int64, np.int64)
    for name, kind in (("unary_codes", np.int64), ("unary_values", np.float64))
)


def reciprocal(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return codes [...] of 1/x in the format's unsigned dtype, from codes [...] of x."""
    return _unary("reciprocal", format, codes)


def rsqrt(format: Float, codes: np.ndarray) -> np.ndarray:
    """Return codes [...] of 1/√x in the format's unsigned dtype, from codes [...] of x."""
    return _unary("rsqrt", format, codes)


def values_of(function: Function, format: Float, values: np.ndarray) -> np.ndarray:
    """Return values [N] of the function of values [N] of the format, float64."""
    if np.isnan(values).any():  # the format may refuse it
        return decode(format, _unary(function, format, encode(format, values)))
    found = np.empty(len(values))
    _values(len(values), values, found, constants(format), *_path(function, format.fraction))
    return found


def _unary(function: Function, format: Float, codes: np.ndarray) -> np.ndarray:
    codes = checked_codes(codes, format.width, str(format))
    given = np.ascontiguousarray(codes.ravel(), np.int64)
    found = np.empty_like(given)
    _codes(len(given), given, found, constants(format), *_path(function, format.fraction))
    return found.astype(code_dtype(format.width)).reshape(codes.shape)


@cache
def _path(function: Function, fraction: int) -> tuple[np.ndarray, ...]:
    """Return `PATH` [1] of a datapath, and its tables."""
    path, found = unary.datapath(function, fraction), np.zeros(1, PATH)
    found["rsqrt"] = function == "rsqrt"
    for name in PATH.names[1 : 9 if path.degree == 2 else 6]:
        found[name] = getattr(path, name)
    return found, *(np.array(table, np.int64) for table in unary.coefficients(path))
