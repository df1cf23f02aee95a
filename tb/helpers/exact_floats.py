"""Floats by exact rationals: the value of a code, and the code of a value.

Shares no code with `spec.number`: both follow from the format's definition.
"""

from fractions import Fraction
from math import inf

from splatcore.spec.number import Float


def infinity_code(format: Float) -> int:
    """Return the first code that is not finite: infinity, or the code after the largest value."""
    return (2**format.exponent - (format.overflow == "infinity")) * 2**format.fraction


def exact(format: Float, code: int) -> Fraction | float:
    """Return the value of a code: a fraction, ±inf, or None for NaN."""
    fraction = code % 2**format.fraction
    exponent = code >> format.fraction & (2**format.exponent - 1)
    sign = -1 if code >> (format.exponent + format.fraction) else 1
    if format.overflow == "infinity" and exponent == 2**format.exponent - 1:
        return None if fraction else sign * inf
    if exponent == 0 and not format.subnormal:
        fraction = 0
    significand = (exponent > 0) * 2**format.fraction + fraction
    return sign * significand * Fraction(2) ** (max(exponent, 1) - format.bias - format.fraction)


def is_negative(format: Float, code: int) -> bool:
    """Return whether a code has its sign set."""
    return bool(code >> (format.exponent + format.fraction))


def nearest(format: Float, value: Fraction | float | None, negative: bool) -> int:
    """Return the code nearest to a value, ties to even; `negative` is the sign of a zero."""
    infinity = infinity_code(format)
    if value is None:
        return infinity + 2 ** (format.fraction - 1)
    negative = value < 0 or (value == 0 and negative)
    if abs(value) == inf:
        code = infinity
    else:
        size = abs(Fraction(value))
        binade = 1 - format.bias
        if size >= Fraction(2) ** binade:
            binade = size.numerator.bit_length() - size.denominator.bit_length()
            binade -= size < Fraction(2) ** binade
        # Python rounds rationals to even.
        steps = round(size / Fraction(2) ** (binade - format.fraction))
        code = (binade + format.bias - 1) * 2**format.fraction + steps
        if not format.subnormal and size < Fraction(2) ** (1 - format.bias):
            code = 2**format.fraction if size > Fraction(2) ** -format.bias else 0
    if format.overflow == "saturate":
        code = min(code, infinity - 1)
        negative = negative and code > 0
    code = min(code, infinity)
    if not format.signed:
        return 0 if negative else code
    return code + negative * 2 ** (format.exponent + format.fraction)
