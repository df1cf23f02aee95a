"""The PEs of a program, compiled: products and sums of float64 values, each rounded at once.

Rounds like `spec.number.Float.round`, but directly on float64's bits.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit

from splatcore.spec.number import Float

ABSENT = -1  # number of an absent operand
PLACES = 52  # bits of float64's fraction
ONES = 2.0**PLACES  # its sum with a smaller number is a whole number


class Rounding(NamedTuple):
    """Parameters of rounding to a `Float`."""

    cut: int  # bits of float64's fraction to drop
    lowest: float  # smallest normal value
    unit: float  # step of values below `lowest`
    largest: float  # largest finite value
    most: float  # result for values above `largest`
    signed: bool
    zero_sign: bool  # −0 keeps its sign


@cache
def rounding(format: Float) -> Rounding:
    """Return the parameters of a format."""
    infinite = format.overflow == "infinity"
    return Rounding(
        PLACES - format.fraction, format.min_normal, format.min_subnormal, format.max,
        np.inf if infinite else format.max, format.signed, infinite,
    )  # fmt: skip


@njit(inline="always")
def rounded(value, to):
    """Return a float64 value rounded to the format, to nearest, ties to even; NaN stays."""
    size = abs(value)
    bits = np.float64(size).view(np.int64)
    bits = bits + ((1 << to.cut >> 1) - 1) + (bits >> to.cut & 1) >> to.cut << to.cut
    near = np.int64(bits).view(np.float64)
    near = to.most if near > to.largest else near
    near = (size / to.unit + ONES - ONES) * to.unit if size < to.lowest else near
    near = np.copysign(near, value) if to.signed or value > 0 else 0.0
    near = near if to.zero_sign else near + 0.0
    return near if value == value else np.nan


@njit(nogil=True, cache=True, error_model="numpy")
def evaluate(steps, values, to):
    """Run the steps of a program.

    steps: [S, 5] int64: numbers of result, a, b and c, and whether the product is subtracted
    values: [V, N] float64, read and written
    to: `Rounding` of the arithmetic
    """
    for s in range(len(steps)):
        made, a, b, c, negate = steps[s]
        product = values[made]
        for k in range(len(product)):
            product[k] = values[a, k] if b == ABSENT else rounded(values[a, k] * values[b, k], to)
        if c != ABSENT:
            sign = -1.0 if negate else 1.0
            for k in range(len(product)):
                product[k] = rounded(values[c, k] + sign * product[k], to)
        elif negate:
            for k in range(len(product)):
                product[k] = -product[k]
