"""The PEs of a program: products and sums of float64 values, each rounded at once.

In C++ (`pe.cpp`), directly on float64's bits; rounds like `spec.number.Float.round`.
"""

from functools import cache
from pathlib import Path

import numpy as np

from splatcore.spec.native import Library
from splatcore.spec.number import Float

ABSENT = -1  # number of an absent operand

FORMAT = np.dtype(
    [(name, np.int64) for name in "exponent fraction bias has_sign zero_sign subnormal".split()]
    + [(name, float) for name in "lowest unit units largest most".split()]
)
"""A `Float`.

zero_sign: −0 keeps its sign, and the highest exponent holds infinities and NaN
lowest: smallest normal value
unit, units: step of values below `lowest`, and its inverse
largest: largest finite value
most: result for values above `largest`
"""

PATH = np.dtype(
    [
        (name, np.int64)
        for name in "rsqrt degree index rest point guard reach_drop square_drop curve_shift".split()
    ]
)
"""A `spec.unary.Datapath`; what its degree does not have is 0. rsqrt: it is not the reciprocal's"""

LIBRARY = Library(
    Path(__file__).with_name("pe.cpp"), {"ABSENT": ABSENT}, {"Format": FORMAT, "Path": PATH}
)

_evaluate = LIBRARY.function("evaluate", int, np.int64, int, np.float64, FORMAT)


@cache
def constants(format: Float) -> np.ndarray:
    """Return `FORMAT` [1] of a format."""
    infinite, unit = format.overflow == "infinity", format.min_subnormal
    values = {"has_sign": format.signed, "zero_sign": infinite, "lowest": format.min_normal}
    values |= {"unit": unit, "units": 1 / unit, "largest": format.max}
    values |= {"most": np.inf if infinite else format.max}
    found = np.zeros(1, FORMAT)
    for name in FORMAT.names:
        found[name] = values[name] if name in values else getattr(format, name)
    return found


def evaluate(steps: np.ndarray, values: np.ndarray, format: Float):
    """Run the steps of a program.

    steps: [S, 5] int64: numbers of result, a, b and c, and whether the product is subtracted
    values: [V, N] float64, read and written
    format: the arithmetic
    """
    _evaluate(len(steps), steps, values.shape[1], values, constants(format))
