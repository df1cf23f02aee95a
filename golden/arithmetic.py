"""Golden model of the floating-point units: arithmetic on codes, each operation rounded once.

Inputs are arrays of codes with shapes that broadcast; results are codes in the format's smallest
dtype.

Each result is computed in float64 and rounded from there, which equals the exact result rounded
once: products of significands of p bits are exact in 53 bits. Sums are rounded to 53 bits first,
which changes nothing as long as 2p + 2 ≤ 53 (Figueroa, "When is double rounding innocuous?", 1995);
sums below the smallest normal value are exact. Wider formats raise ValueError.
"""

from typing import NamedTuple

import numpy as np

from splatcore.spec.number import Fixed, Float

FLOAT64 = 53  # bits of float64's significand


class Parts(NamedTuple):
    """Floats as (−1)^negative · significand · 2^(exponent − fraction), int64 [N] each."""

    negative: np.ndarray
    exponent: np.ndarray
    significand: np.ndarray


def take_apart(format: Float, codes: np.ndarray) -> Parts:
    """Split codes [N] into sign, exponent and significand.

    An infinity becomes a power of two above all numbers, a NaN a larger number.
    """
    codes = codes.astype(np.int64)
    biased = codes >> format.fraction & ((1 << format.exponent) - 1)
    fraction, hidden = codes & ((1 << format.fraction) - 1), 1 << format.fraction
    significand = np.where(biased > 0, fraction | hidden, fraction * format.subnormal)
    negative = codes >> (format.width - 1) & format.signed
    return Parts(negative, np.maximum(biased, 1) - format.bias, significand)


def _checked(format: Float) -> None:
    """Raise ValueError for a format whose sums float64 would round twice."""
    if 2 * (format.fraction + 1) + 2 > FLOAT64:
        raise ValueError(f"{format}: sums in float64 would be rounded twice")


def multiply(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the codes of a · b, rounded once."""
    _checked(format)
    with np.errstate(invalid="ignore", over="ignore"):  # ∞ · 0; float64 overflows after the format
        return format.encode(format.decode(a) * format.decode(b))


def add(format: Float, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the codes of a + b, rounded once."""
    _checked(format)
    with np.errstate(invalid="ignore"):  # ∞ − ∞
        return format.encode(format.decode(a) + format.decode(b))


def multiply_add(format: Float, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the codes of a · b + c, rounded after the multiplication and after the addition."""
    return add(format, multiply(format, a, b), c)


def compare(format: Float, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a < b and a = b as codes of one bit; both are 0 if a or b is NaN."""
    a, b = format.decode(a), format.decode(b)
    return (a < b).astype(np.uint8), (a == b).astype(np.uint8)


def convert(source: Float, target: Float, code: np.ndarray, scale: int = 0) -> np.ndarray:
    """Return codes times 2^scale in another format; NaN becomes 0 if that format has none."""
    value = np.ldexp(source.decode(code), scale)
    if target.overflow == "saturate":
        value = np.where(np.isnan(value), 0.0, value)
    return target.encode(value)


def from_fixed(fixed: Fixed, format: Float, code: np.ndarray) -> np.ndarray:
    """Return codes of a fixed-point format as codes of a float."""
    if fixed.width > FLOAT64:
        raise ValueError(f"{fixed}: decoding to float64 would round")
    return format.encode(fixed.decode(code))


def to_fixed(format: Float, fixed: Fixed, code: np.ndarray) -> np.ndarray:
    """Return codes of a float as fixed-point codes, rounded and saturated; NaN becomes 0."""
    value = format.decode(code)
    return fixed.encode(np.where(np.isnan(value), 0.0, value))
