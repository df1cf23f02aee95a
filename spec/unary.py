"""Reciprocal 1/x and reciprocal square root 1/√x of floats: sizes, coefficients, special cases.

A number is x = ±1.f · 2^e with a fraction f of F bits; for rsqrt e is split into 2q + p with
p = 0 or 1. One table serves the significand, in one binade of results:

    reciprocal       y = 2 / 1.f            1/x  = y · 2^(−e−1)        1 < y ≤ 2
    rsqrt  y = 2 / √(1.f · 2^p)   1/√x = y · 2^(−q−1)        1 < y ≤ 2

and y − 1 is computed in units of the result's last place, 2^−F:

    sum      = offset · 2^(point−guard)  +  slope · below  +  (curve · square) · 2^curve_shift
    fraction = ⌊sum / 2^point⌋ mod 2^(F+1)                  (2^F carries into the exponent)

- The upper `index` bits of f, below p for rsqrt, select offset, slope and curve from tables.
- `below` is the complement of the other `rest` bits of f: the distance to the interval's end.
- `square` is even about the interval's middle: the highest bit of those `rest` bits, if clear,
  complements the others; the upper `reach` bits of these are a; a·(a+1) loses its lowest
  2·`reach` − `square` bits. All terms are positive, and both functions fall and are convex.
- `offset` includes half a unit, so that ⌊ ⌋ rounds to nearest; the sum wraps at 2^(F+1+point), and
  offsets are residues of it: the last ones may be below zero.

Degree 2 has all three terms, degree 1 no curve, degree 0 only an offset for each f.

**Results** are rounded once, to nearest, from `sum`. A biased exponent below 1 (format with
subnormal values) shifts one place further right for each step, and (2^places − 1) · 2^(point−1)
added to `sum` makes its half unit the half unit of the shifted result. Formats without subnormal
values return `min_normal` for results in (½, 1) · min_normal and 0 up to ½, like `Float.encode`.
Subnormal inputs count in full; formats without subnormal values read an input of biased exponent 0
as zero.

| input | overflow="saturate" | overflow="infinity" (IEEE 754-2019, 9.2) |
|---|---|---|
| 1/±0 | ±max | ±∞ |
| 1/x above the largest value | ±max | ±∞ |
| 1/±∞ | | ±0 |
| 1/√+0, 1/√−0 | max, max | +∞, −∞ |
| 1/√x, x < 0 | max, as for a zero that rounding made negative | NaN |
| 1/√+∞ | | +0 |
| NaN | | the NaN of `Float.encode` |

Saturating formats have one zero, 0: a result that rounds to −0 is 0. An input with only its sign
set is a zero whose sign counts.

**Error.** |result − exact| < 0.73 units in the last place for 3 … 18 fraction bits, < 0.77 for
19 … 23: ½ from rounding and about ¼ from the sum. Results of powers of two (of four) are exact.
Both functions are monotone. Measured over every f (at both p):

| fraction bits | 6 | 8 | 10 | 12 | 14 | 16 | 18 | 20 | 23 |
|---|---|---|---|---|---|---|---|---|---|
| degree | 0 | 1 | 1 | 1 | 2 | 2 | 2 | 2 | 2 |
| reciprocal: index | 6 | 5 | 6 | 7 | 6 | 7 | 7 | 8 | 9 |
| reciprocal: error | 0.496 | 0.658 | 0.695 | 0.669 | 0.698 | 0.684 | 0.701 | 0.716 | 0.741 |
| rsqrt: index | 6 | 4 | 5 | 6 | 5 | 6 | 6 | 7 | 8 |
| rsqrt: error | 0.494 | 0.690 | 0.704 | 0.705 | 0.684 | 0.722 | 0.723 | 0.720 | 0.760 |

Coefficients are computed from integers alone: the same on every host.
"""

from dataclasses import dataclass
from functools import cache
from math import isqrt
from typing import Literal, NamedTuple

import numpy as np

from splatcore.spec.number import Float

Function = Literal["reciprocal", "rsqrt"]

FRACTION_MIN, FRACTION_MAX = 3, 23
"""Fraction widths. With fewer bits, rounding a subnormal result could carry past bit F of the sum;
with more, tables would grow: they have about 2^(F/3) entries.
"""

DEGREE_FRACTION = (6, 12)
"""Widest fractions for degree 0 and for degree 1: above, the next degree takes fewer gates."""

FIT_POINTS = 1024
"""Maximum number of points per interval from which its offset is fitted."""

FIT_BITS = 8
"""Bits of the exact function below the sum's last bit, while fitting."""


@dataclass(frozen=True)
class Datapath:
    """Sizes of one function at one fraction width, in bits; the module's docstring defines them."""

    function: Function
    fraction: int
    degree: int
    index: int
    guard: int  # bits of an offset below the result's last place
    point: int  # bits of the sum, and of a slope, below the result's last place
    reach: int = 0
    square: int = 0
    curve_point: int = 0  # bits of a curve below the point of y''/2

    @property
    def rest(self) -> int:
        """Bits of the fraction below the index."""
        return self.fraction - self.index

    @property
    def address(self) -> int:
        """Bits that select an entry of the tables; for rsqrt, p is above the index."""
        return self.index + (self.function == "rsqrt")

    @property
    def reach_drop(self) -> int:
        """Low bits of the distance from the middle that are dropped before squaring."""
        return self.rest - 1 - self.reach

    @property
    def square_drop(self) -> int:
        """Low bits of a·(a+1) that are dropped."""
        return 2 * self.reach - self.square

    @property
    def curve_shift(self) -> int:
        """Left shift of curve · square to the sum's point."""
        dropped = 2 * self.reach_drop + self.square_drop
        return self.point + dropped - self.curve_point - self.fraction


@cache
def datapath(function: Function, fraction: int) -> Datapath:
    """Return the datapath with the fewest gates of those below, error below ¾ unit at 16 bits.

    Tables, multipliers and sum for 16 fraction bits, in NAND2-equivalents; error in units:

    | degree, index | 1, 8 | 1, 9 | 2, 5 | 2, 6 | 2, 7 |
    |---|---|---|---|---|---|
    | reciprocal | 2132; 0.81 | 2678; 0.66 | 3425; 0.68 | 2558; 0.71 | **2196; 0.68** |
    | rsqrt | 2904; 0.70 | | 2882; 0.68 | **2357; 0.72** | 2454; 0.76 |
    """
    if not FRACTION_MIN <= fraction <= FRACTION_MAX:
        limits = f"{FRACTION_MIN} … {FRACTION_MAX}"
        raise ValueError(f"{function}: {fraction} fraction bits are not in {limits}")
    degree = sum(fraction > widest for widest in DEGREE_FRACTION)
    if degree == 0:
        return Datapath(function, fraction, degree, index=fraction, guard=1, point=1)
    # At 1.f = 1, where both curve most, y''/2 is 2 for the reciprocal and ¾ for rsqrt: the
    # intervals of rsqrt may be twice as long.
    steep = function == "reciprocal"
    index = -(-fraction // (3 if degree == 2 else 2)) + steep
    point = fraction - index + 1
    if degree == 1:
        return Datapath(function, fraction, degree, index, guard=2, point=point)
    # At its end the curve's term is worth 2^(fraction − 2·index) times ½ unit (rsqrt: 0.19): with
    # these bits of distance and curvature its error is an eighth of a unit.
    reach = fraction - 2 * index + (3 if steep else 1)
    curve_point = reach - (3 if steep else 1)
    return Datapath(function, fraction, degree, index, 3, point, reach, reach, curve_point)


class Coefficients(NamedTuple):
    """Tables of a datapath: one integer ≥ 0 per address."""

    offset: tuple[int, ...]
    slope: tuple[int, ...]
    curve: tuple[int, ...]


@cache
def coefficients(path: Datapath) -> Coefficients:
    """Fit slope and curve through the Chebyshev nodes, offset midway between the largest errors."""
    rows = [_fit(path, address) for address in range(1 << path.address)]
    return Coefficients(*zip(*rows, strict=True))


def _fit(path: Datapath, address: int) -> tuple[int, int, int]:
    """Return offset, slope and curve of one interval."""
    parity, index = divmod(address, 1 << path.index)
    end = (1 << path.rest) - 1

    def exact(rest):
        fraction = (index << path.rest) + rest
        known = _exact if np.ndim(rest) == 0 else _exact_array
        return known(path.function, path.fraction, parity, fraction, path.point + FIT_BITS)

    slope = curve = 0
    if path.degree == 1:  # the chord's slope is the best for a convex function
        slope = _divide(exact(0) - exact(end), end << FIT_BITS)
    if path.degree == 2:
        # Chebyshev nodes ±√¾ of half the interval, in half steps from its middle: odd numbers.
        node = isqrt(3 * 4**path.rest // 4) | 1
        low, high = exact((end - node) // 2), exact((end + node) // 2)
        bend = low + high - exact(end // 2) - exact(end // 2 + 1)
        slope = _divide(low - high, node << FIT_BITS)
        # square ≈ (distance² − 1) / 4 / 2^dropped, with the distance in half steps.
        dropped = 2 * path.reach_drop + path.square_drop
        curve = _divide(bend << dropped + 1, (node**2 - 1) << FIT_BITS + path.curve_shift)
    points = np.array([*range(0, end + 1, (end + 1) // FIT_POINTS | 1), end])
    wanted = exact(points) - (_terms(path, slope, curve, points) << FIT_BITS)
    middle = (int(wanted.min() + wanted.max()) >> FIT_BITS + 1) + (1 << path.point - 1)
    unit = 1 << path.point - path.guard
    offset = (middle + unit // 2) // unit
    return offset % (1 << path.fraction + 1 + path.guard), slope, curve


def _terms(path: Datapath, slope: int, curve: int, rest: np.ndarray) -> np.ndarray:
    """Return the sum without its offset, int64."""
    if not path.degree:
        return np.zeros_like(rest)
    linear = slope * ((1 << path.rest) - 1 - rest)
    if path.degree == 1:
        return linear
    distance = np.where(rest >> path.rest - 1, rest, ~rest)
    a = (distance & (1 << path.rest - 1) - 1) >> path.reach_drop
    return linear + (curve * (a * (a + 1) >> path.square_drop) << path.curve_shift)


def _exact(function: Function, fraction: int, parity: int, value: int, below: int) -> int:
    """Return ⌊(y − 1) · 2^(fraction + below)⌋; significand (2^fraction + value) · 2^parity."""
    scale = fraction + below
    significand = (1 << fraction) + value << parity
    if function == "reciprocal":
        y = (1 << scale + fraction + 1) // significand
    else:
        y = isqrt((1 << 2 * scale + fraction + 2) // significand)
    return y - (1 << scale)


def _exact_array(
    function: Function, fraction: int, parity: int, value: np.ndarray, below: int
) -> np.ndarray:
    """The same for values [N], int64: from float64, or exactly if that is too near an integer."""
    scale = fraction + below
    inverse = 2.0**fraction / ((1 << fraction) + value << parity)
    y = np.ldexp(2 * inverse if function == "reciprocal" else np.sqrt(4 * inverse), scale)
    found = np.floor(y).astype(np.int64) - (1 << scale)
    for k in np.flatnonzero(np.abs(y - np.rint(y)) < np.ldexp(1.0, scale - 50)):
        found[k] = _exact(function, fraction, parity, int(value[k]), below)
    return found


def _divide(numerator: int, denominator: int) -> int:
    """Return the nearest integer to a quotient of positive numbers."""
    return (2 * numerator + denominator) // (2 * denominator)


def result_exponent(function: Function, format: Float, biased: np.ndarray) -> np.ndarray:
    """Return the biased exponent of y's binade; it may be outside the format's range.

    biased: biased exponent of the normalised input, an integer or an array, of any sign; an input
        that was shifted by n places to normalise it has 1 − n
    """
    if function == "reciprocal":
        return 2 * format.bias - 1 - biased
    return format.bias - 1 - (biased - format.bias >> 1)


def exponent_max(format: Float) -> int:
    """Return the biased exponent of the largest finite value."""
    return (1 << format.exponent) - 1 - (format.overflow == "infinity")


def places_in(function: Function, format: Float) -> int:
    """Return the maximum places to normalise an input; with more its result overflows."""
    places = range(1, 1 + format.fraction * format.subnormal)
    top = exponent_max(format)
    return sum(result_exponent(function, format, 1 - n) <= top for n in places)


def places_out(function: Function, format: Float) -> int:
    """Return the maximum places to shift a subnormal result."""
    least = result_exponent(function, format, exponent_max(format))
    return max(0, 1 - least) if format.subnormal else 0
