"""Colours of Gaussians from spherical harmonics of degree 0 … 3, in small integers.

A Gaussian's colour is a base and, for each degree, a sum of coefficients times polynomials of the
unit direction (x, y, z) from the camera to the Gaussian. The polynomials are the real spherical
harmonics of 3DGS without their constants, scaled by powers of two so that the constants of a degree
agree within a quarter; packing multiplies the constants into the coefficients (`folded`):

    degree 1    y, z, x
    degree 2    2xy, 2yz, (3zz − 1)/2, 2xz, xx − yy
    degree 3    y(3xx − yy), 4xyz, y(5zz − 1), z(5zz − 3)/2, x(5zz − 1), 2z(xx − yy), x(3yy − xx)

The microprogram below evaluates them in floats of `BASIS` (`spec.microprogram`); `POLYNOMIAL`
rounds each to an integer in steps of 2^−11. The rest is integers, exact except for the shift and
the last line:

    sum    = Σ multiplicand · polynomial              over the (up to three) polynomials of a term
    total += (sum · factor · 2^GAIN) >> shift         ⌊ ⌋, steps 2^−TOTAL_FRACTION, for each term
    colour = total to the nearest (a half upwards)    of `unscaled_colour_format`, which clamps it

**Steps** (models whose header names no codebooks). A code k of b bits, two's complement, stands for
k steps, or for k + ½ steps if the layout is in `halves`; its multiplicand is 2k, or 2k + 1. The
base is ½ + its term, whose polynomial is 1. The step of degree d is (1 or ¾) · 2^(E − ⌊s/2⌋ − g),
with E of the model's header; s of the chunk's header, whose lowest bit chooses ¾; g of the
Gaussian, 0 for the base. So factor = 4 or 3, and shift = GAIN − E + ⌊s/2⌋ + g.

**Codebooks**. The base is the sum of colour entries, times 2^E, and no ½ is added: multiplicand
2·sum, shift = GAIN − E. The elements of G are sums of SH entries, times 2^E, and form two terms of
degree 1, with the multiplicands G mod 2^LOW and ⌊G / 2^LOW⌋, and shifts GAIN − E − 1 and
GAIN − E − 1 − LOW. factor = 4.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from splatcore.spec.config import Config
from splatcore.spec.number import Bits, Fixed, Float
from splatcore.spec.record import Array, Format, Record

BASIS = Float(7, 11, subnormal=False)
"""Floats in which directions and polynomials are evaluated."""

POLYNOMIAL = Fixed(1, 11, signed=True)
"""A polynomial's value, rounded for the sums."""

CHANNELS = ("red", "green", "blue")
"""Colour channels, in the order of records and pixels."""

COLOUR_INTEGER = 3
"""Bits of a splat's colour above the point."""

COLOUR_GUARD = 3
"""Additional fraction bits of a colour before it is scaled by 255/256."""


def colour_format(config: Config) -> Fixed:
    """A splat's red, green or blue, in units of 255/256."""
    return Fixed(COLOUR_INTEGER, config.colour_fraction)


def background_codes(config: Config, background: tuple[float, float, float]) -> tuple[int, ...]:
    """Return the codes of an RGB colour 0 … 1, in units of 255/256."""
    colour = colour_format(config).encode(np.array(background) * 255 / 256)
    return tuple(int(code) for code in colour)


def unscaled_colour_format(config: Config) -> Fixed:
    """A splat's red, green or blue before it is scaled by 255/256."""
    return Fixed(COLOUR_INTEGER, config.colour_fraction + COLOUR_GUARD)


def scaled_colours(codes):
    """Scale colours by 255/256, rounded to nearest.

    codes: integers or hardware values of `unscaled_colour_format`
    Returns codes of `colour_format`.
    """
    finer = COLOUR_GUARD + 8
    return ((codes << 8) - codes + (1 << finer - 1)) >> finer


DEGREES = 4
"""Number of degrees of harmonics, 0 … 3."""


def coefficient_count(degree: int) -> int:
    """Return the number of polynomials of a degree."""
    return 2 * degree + 1


@dataclass(frozen=True)
class Term:
    """Up to three polynomials of one degree that are summed in one cycle.

    A machine that sums two terms per cycle takes a term and its `follower` together.
    """

    degree: int  # degree of the harmonics
    polynomials: tuple[str, ...]  # names of their values in the program
    doubled: tuple[int, ...]  # per polynomial, log2 of the factor that the program leaves out
    follower: bool = False  # of the term before, which has the same degree; at most two polynomials

    @property
    def first(self) -> int:
        """Index of its first polynomial within the degree."""
        terms = [term for term in TERMS if term.degree == self.degree]
        return sum(len(term.polynomials) for term in terms[: terms.index(self)])


TERMS = (
    Term(1, ("y", "z", "x"), (0, 0, 0)),
    Term(2, ("xy", "yz", "polar"), (1, 1, -1)),
    Term(2, ("xz", "saddle"), (1, 0), follower=True),
    Term(3, ("lobe_y", "xyz", "ring_y"), (0, 2, 0)),
    Term(3, ("axial", "ring_x", "wheel"), (-1, 0, 1)),
    Term(3, ("lobe_x",), (0,), follower=True),
)
"""All terms except the base, in the order in which they are summed."""

DIRECTION = """
# the unit vector from the camera
length_squared = ray_x * ray_x + ray_y * ray_y + ray_z * ray_z
length_inverse = rsqrt(length_squared)
x = ray_x * length_inverse
y = ray_y * length_inverse
z = ray_z * length_inverse
"""

OF_SECOND = """
# polynomials of degree 2 without their powers of two; xx + yy + zz = 1
xy = x * y
yz = y * z
xz = x * z
zz = z * z
polar = zz * three + minus_one
xx = x * x
saddle = xx - y * y
"""

OF_THIRD = """
# polynomials of degree 3, likewise
twice_xx = xx + xx
lobe0 = twice_xx + saddle
lobe_y = y * lobe0
lobe1 = twice_xx - saddle * three
lobe_x = x * lobe1
xyz = xy * z
ring = zz * five + minus_one
ring_y = y * ring
ring_x = x * ring
axial0 = zz * five + minus_three
axial = z * axial0
wheel = z * saddle
"""

BASIS_OF = {1: DIRECTION, 2: DIRECTION + OF_SECOND, 3: DIRECTION + OF_SECOND + OF_THIRD}
"""Highest degree of the harmonics → program that evaluates their polynomials (`TERMS`)."""

BASIS_CONSTANTS = {
    "three": 3.0, "five": 5.0, "minus_one": -1.0, "minus_three": -3.0
}  # fmt: skip
"""Constants of these programs, the same in all frames."""


def polynomials(degree: int) -> list[str]:
    """Names of the polynomials up to a degree in the program, in the order of `TERMS`."""
    return [name for term in TERMS if term.degree <= degree for name in term.polynomials]


SH_C0 = 1 / np.sqrt(4 * np.pi)
SH_C1 = np.sqrt(3 / (4 * np.pi))
"""Constants of the harmonics of degree 0 and 1; degree 1 is (−C1·y, C1·z, −C1·x) in 3DGS."""

FOLDED = {
    0: np.array([SH_C0]),
    1: SH_C1 * np.array([-1, 1, -1]),
    2: np.sqrt(np.array([15, 15, 5, 15, 15]) / (4 * np.pi)) * np.array([1, -1, 2, -1, 1]) / 2,
    3: np.sqrt(np.array([35 / 8, 105, 21 / 8, 7, 21 / 8, 105 / 4, 35 / 8]) / (4 * np.pi))
    * np.array([-1, 1 / 4, -1, 1, -1, 1 / 2, 1]),
}
"""Degree → for each coefficient of 3DGS the constant of its polynomial."""


def folded(sh: np.ndarray) -> list[np.ndarray]:
    """Multiply the constants of the harmonics into the coefficients.

    sh: [N, (degree+1)², 3] coefficients of 3DGS, RGB
    Returns for each degree the factors [N, k, 3] of its polynomials; degree 0 is the colour without
    harmonics, minus ½.
    """
    degrees = range(int(np.sqrt(sh.shape[1])))
    return [sh[:, d * d : (d + 1) ** 2] * FOLDED[d][:, None] for d in degrees]


def unfolded(factors: list[np.ndarray]) -> np.ndarray:
    """Invert `folded`."""
    return np.concatenate([f / FOLDED[d][:, None] for d, f in enumerate(factors)], axis=1)


def slopes_of(first: np.ndarray) -> np.ndarray:
    """Return G [N, 3, 3] (channel × direction axis) of factors [N, 3, 3] of y, z, x."""
    return np.moveaxis(first[:, [2, 0, 1]], 1, 2)


def from_slopes(slopes: np.ndarray) -> np.ndarray:
    """Invert `slopes_of`."""
    return np.moveaxis(slopes, 2, 1)[:, [1, 2, 0]]


@dataclass(frozen=True)
class Harmonics:
    """Layout of a Gaussian's coefficients in the beats after its first."""

    beats: int  # number of these beats
    bits: tuple[int, ...] = ()  # bits of a coefficient, for degree 1, 2, … in turn
    halves: bool = False  # codes stand for k + ½ steps

    @property
    def degree(self) -> int:
        """Highest degree with coefficients."""
        return len(self.bits)

    def format(self, degree: int) -> Fixed:
        """Format of a coefficient's code."""
        return Fixed(self.bits[degree - 1] - 1, 0, signed=True)

    @cached_property
    def records(self) -> list[Record]:
        """The beats' records.

        shift1 …: the Gaussian's own g of a degree, 2 bits
        red_0 … blue_5: per term and channel, an array of the term's codes

        All codes of a term are in one beat: the first beat with enough room.
        """
        beats: list[dict[str, Format]] = [{} for _ in range(self.beats)]
        for degree in range(1, self.degree + 1):
            beats[0][f"shift{degree}"] = Bits(SHIFT_BITS)
        for number, term in self.terms:
            codes = Array(self.format(term.degree), len(term.polynomials))
            fields = {f"{c}_{number}": codes for c in CHANNELS}
            wanted = sum(format.width for format in fields.values())
            beat = next(b for b in beats if BEAT_BITS - _width(b) >= wanted)
            beat |= fields
        for beat in beats:
            if spare := BEAT_BITS - _width(beat):
                beat["reserved"] = Bits(spare)
        return [Record(f"harmonics{k}", beat) for k, beat in enumerate(beats)]

    @property
    def terms(self) -> list[tuple[int, Term]]:
        """The terms with coefficients, and their indices in `TERMS`."""
        return [(k, term) for k, term in enumerate(TERMS) if term.degree <= self.degree]


def _width(fields: dict[str, Format]) -> int:
    return sum(format.width for format in fields.values())


BEAT_BITS = 128
"""Bits of a beat of attributes."""

SHIFT_BITS = 2
"""Bits of g, by which a Gaussian's step of a degree is halved."""

LAYOUTS = (
    Harmonics(0),
    Harmonics(1, (5, 5)),
    Harmonics(1, (3, 2, 3), halves=True),
    Harmonics(2, (5, 5, 6)),
)
"""Layouts by the number in a chunk's header.

0: no harmonics
1: degrees 1 and 2
2: degrees 1 to 3, coarse
3: degrees 1 to 3, fine
"""

SECOND, COARSE, FINE = range(1, len(LAYOUTS))
"""Indices of the layouts with harmonics in `LAYOUTS`."""

LAYOUT_BITS = (len(LAYOUTS) - 1).bit_length()
"""Width of an index into `LAYOUTS`."""

BASE = Fixed(8, 0, signed=True)
"""A component of the base, in steps from ½."""

STEP_BITS = 4
"""Bits of s: how much finer a chunk's step of a degree is than 2^E, in half octaves."""

LOW = 6
"""Number of low bits of an element of G that form its first term."""

TOTAL_FRACTION = POLYNOMIAL.fraction + 3
"""Fraction bits of the total: fraction bits of a sum at E = 0 with half steps and quarters."""

GAIN = 4
"""Bits by which a sum is shifted up before it is shifted down, so that E may be above 0."""

EXPONENT_MIN, EXPONENT_MAX = -15, GAIN
"""Limits of E: coefficients up to 2^9, far beyond the largest colour, in steps down to 2^−25."""

SH_EXPONENT_MAX = GAIN - 1 - LOW
"""Largest E of a codebook of G."""


def step(s: np.ndarray, exponent: int) -> np.ndarray:
    """Return the steps [...] of chunks with codes s [...]; exponent: E of the degree."""
    s = np.asarray(s, np.int64)
    return np.ldexp(1 - (s & 1) / 4, exponent - (s >> 1))
