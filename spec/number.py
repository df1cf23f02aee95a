"""Number formats: how a real number is represented in the machine, to the bit.

A format is a frozen value object. `encode` rounds float64 values to codes, `decode` returns the
values of codes, `round` does both. They take arrays of any shape and return the same shape. A
*code* is an unsigned bit pattern of `width` bits in the smallest unsigned dtype that holds it: the
bits on a wire. Nothing here rounds twice: every result is the exact real input rounded once, for
every float64 (subnormals, ±inf and huge values included).

Values are float64. Codes outside 0 … 2^width − 1 raise ValueError, codes that are not integers
raise TypeError.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

Rounding = Literal["nearest-even", "floor", "ceiling"]
Overflow = Literal["saturate", "infinity"]

ROUNDING = {"nearest-even": np.rint, "floor": np.floor, "ceiling": np.ceil}
"""Rounding → function from float64 to integral float64."""

BITS_MAX = 64
"""Maximum width of a code, numpy's widest integer."""


def code_dtype(width: int) -> np.dtype:
    """Return the smallest unsigned dtype that holds `width` bits."""
    return np.dtype(next(f"u{size}" for size in (1, 2, 4, 8) if width <= 8 * size))


def checked_codes(codes: np.ndarray, width: int, name: str) -> np.ndarray:
    """Return `codes` as `code_dtype(width)`; raise, naming `name`, if one does not fit."""
    codes = np.asarray(codes)
    dtype = code_dtype(width)
    if codes.dtype.kind not in "biu":
        raise TypeError(f"{name}: codes are integers, not {codes.dtype}")
    if codes.dtype != dtype or width < 8 * dtype.itemsize:
        for extreme in (codes.min(initial=0), codes.max(initial=0)):
            if not 0 <= int(extreme) < 1 << width:
                raise ValueError(f"{name}: code {extreme} does not fit in {width} bits")
    return codes.astype(dtype, copy=False)


class Rounds:
    """A format that rounds by encoding and decoding."""

    def round(self, values: np.ndarray) -> np.ndarray:
        """Return the nearest values of the format: float64, except for `Bits`."""
        return self.decode(self.encode(values))


@dataclass(frozen=True)
class Bits(Rounds):
    """Unsigned integers of `width` bits: indices, masks, counts.

    `encode` raises an error for values that do not fit, it never saturates; `decode` returns
    integers.
    """

    width: int

    def __post_init__(self):
        if not 1 <= self.width <= BITS_MAX:
            raise ValueError(f"{self}: width is not in 1 … {BITS_MAX}")

    def encode(self, values: np.ndarray) -> np.ndarray:
        """Return integers as codes of the smallest unsigned dtype."""
        return checked_codes(values, self.width, str(self))

    def decode(self, codes: np.ndarray) -> np.ndarray:
        """Return the codes themselves."""
        return checked_codes(codes, self.width, str(self))


@dataclass(frozen=True)
class Fixed(Rounds):
    """Fixed point: a two's complement (or unsigned) integer times 2^−fraction.

    integer: bits above the binary point
    fraction: bits below the binary point
    signed: one more bit for the sign, so width = integer + fraction + signed

    integer or fraction may be negative, which moves the point out of the word: Fixed(−4, 20) holds
    16 bits worth 2^−20 … 2^−5, Fixed(20, −4) holds 16 bits worth 2^4 … 2^19.

    `encode` saturates at both ends (negative values become 0 if unsigned, ±inf an end) and raises
    ValueError on NaN. `decode` is exact up to 53 bits; wider codes round to the nearest float64.
    """

    integer: int
    fraction: int
    signed: bool = False
    rounding: Rounding = "nearest-even"

    def __post_init__(self):
        if not 1 <= self.width < BITS_MAX:
            raise ValueError(f"{self}: width {self.width} is not in 1 … {BITS_MAX - 1}")
        if self.integer > 1023 or self.fraction > 1022:
            raise ValueError(f"{self}: outside the range of float64")
        if self.rounding not in ROUNDING:
            raise ValueError(f"{self}: rounding is not one of {', '.join(ROUNDING)}")

    @property
    def width(self) -> int:
        return self.integer + self.fraction + self.signed

    @property
    def step(self) -> float:
        """The value of the least significant bit."""
        return 2.0**-self.fraction

    @property
    def min(self) -> float:
        """The smallest value."""
        return -(2.0**self.integer) if self.signed else 0.0

    @property
    def max(self) -> float:
        """The largest value, 2^integer − step (to the nearest float64 above 53 bits)."""
        return (2 ** (self.integer + self.fraction) - 1) * self.step

    def encode(self, values: np.ndarray) -> np.ndarray:
        """Return values as codes: rounded to a multiple of `step`, then saturated."""
        values = np.asarray(values, np.float64)
        if np.isnan(values).any():
            raise ValueError(f"{self} has no code for NaN")
        # value / step = mantissa · 2^scale, with |mantissa| in [0.5, 1). Below 2^−1 all values of
        # one sign round alike and above 2^width they all saturate, so clipping the scale changes
        # no code; it keeps ldexp exact, which would else underflow or overflow.
        mantissa, exponent = np.frexp(values)
        scale = np.clip(exponent + self.fraction, -1, self.width + 1)
        steps = ROUNDING[self.rounding](np.ldexp(mantissa, scale))
        # The end is 2^n − 1, which float64 cannot hold for large n: compare with 2^n instead.
        end = 1 << (self.integer + self.fraction)
        above = steps >= end
        codes = np.where(above, 0, np.maximum(steps, -end if self.signed else 0)).astype(np.int64)
        codes = np.where(above, end - 1, codes) & ((1 << self.width) - 1)
        return codes.astype(code_dtype(self.width))

    def decode(self, codes: np.ndarray) -> np.ndarray:
        """Return the values of codes, float64."""
        steps = checked_codes(codes, self.width, str(self)).astype(np.int64)
        if self.signed:
            sign = 1 << (self.width - 1)
            steps = (steps ^ sign) - sign
        return np.ldexp(steps.astype(np.float64), -self.fraction)


@dataclass(frozen=True)
class Float(Rounds):
    """Binary floating point in the layout of IEEE 754: sign, `exponent` bits, `fraction` bits.

    A code with biased exponent e and fraction f is worth (1 + f·2^−fraction) · 2^(e − bias); with
    e = 0 it is worth f·2^−fraction · 2^(1 − bias). Rounding is to nearest, ties to even. The codes
    of non-negative values rise with the value, so a depth key may be compared as an integer.

    overflow="infinity" is IEEE 754 exactly: the highest e holds infinities and NaN, values past the
    largest finite one by half a step or more become infinite, and −0 keeps its sign. Every NaN
    becomes the one code with sign 0 and only the highest fraction bit set. overflow="saturate" uses
    the highest e as one more binade: no infinity, no NaN (ValueError); larger values become the
    largest one. Zero has one code, 0: −0 and negative values that round to zero also become 0. The
    code with only the sign set, which `encode` never returns, decodes to 0.

    subnormal=False drops the values with e = 0 except zero itself, like hardware without a
    normalising shift: a value below `min_normal` rounds to the nearer of 0 and `min_normal`, and to
    0 from half-way (both codes are even). Codes with e = 0 decode to zero, whatever their fraction.

    signed=False has no sign bit: negative values, −inf too, become 0.
    """

    exponent: int
    fraction: int
    signed: bool = True
    subnormal: bool = True
    overflow: Overflow = "saturate"

    def __post_init__(self):
        # 10 and 52 keep every value, and every value scaled by 2^fraction, inside float64; a
        # fraction of no bits has no even neighbour to round a tie to.
        if not 2 <= self.exponent <= 10:
            raise ValueError(f"{self}: exponent is not in 2 … 10 bits")
        if not 1 <= self.fraction <= 52:
            raise ValueError(f"{self}: fraction is not in 1 … 52 bits")
        if self.overflow not in ("saturate", "infinity"):
            raise ValueError(f"{self}: overflow is not saturate or infinity")

    @property
    def width(self) -> int:
        return self.signed + self.exponent + self.fraction

    @property
    def bias(self) -> int:
        """Biased exponent of the binade [1, 2)."""
        return (1 << (self.exponent - 1)) - 1

    @property
    def _code_max(self) -> int:
        """Code of the largest finite value."""
        binades = (1 << self.exponent) - (self.overflow == "infinity")
        return (binades << self.fraction) - 1

    @property
    def max(self) -> float:
        """The largest finite value."""
        return float(self.decode(self._code_max))

    @property
    def min_normal(self) -> float:
        """The smallest value with full relative precision."""
        return 2.0 ** (1 - self.bias)

    @property
    def min_subnormal(self) -> float:
        """The smallest positive value: `min_normal` if the format has no subnormal values."""
        return self.min_normal * (2.0**-self.fraction if self.subnormal else 1.0)

    @property
    def epsilon(self) -> float:
        """Bound on the relative error of rounding from `min_normal` to `max`: half a step at 1."""
        return 2.0 ** -(self.fraction + 1)

    def encode(self, values: np.ndarray) -> np.ndarray:
        """Return values as codes, rounded to nearest, ties to even."""
        values = np.asarray(values, np.float64)
        nan = np.isnan(values)
        if self.overflow == "saturate" and nan.any():
            raise ValueError(f"{self} has no code for NaN")
        codes = self._encode_magnitude(np.abs(values))
        negative = np.signbit(values)
        if self.signed:
            if self.overflow == "saturate":
                negative &= codes != 0
            codes = codes | negative.astype(np.uint64) << (self.width - 1)
        else:
            codes = np.where(negative, 0, codes)
        quiet = self._code_max + 1 | 1 << (self.fraction - 1)
        return np.where(nan, quiet, codes).astype(code_dtype(self.width))

    def _encode_magnitude(self, magnitude: np.ndarray) -> np.ndarray:
        """Return the codes of values ≥ 0, uint64; the code of a NaN has no meaning."""
        # float64's largest finite value is past the end of every format, like infinity.
        magnitude = np.where(np.isfinite(magnitude), magnitude, np.finfo(np.float64).max)
        # Binade 0 begins at `min_normal`: [1, 2) · 2^(1 − bias). Smaller values share its step,
        # 2^(1 − bias − fraction); each further binade doubles the step.
        _, exponent = np.frexp(np.maximum(magnitude, self.min_normal))  # [0.5, 1) · 2^exponent
        binade = exponent + (self.bias - 2)
        steps = np.rint(np.ldexp(magnitude, self.bias + self.fraction - 1 - binade))
        # `steps` includes the hidden bit, which adds 1 to the exponent of every normal value; so
        # does the carry of a value that rounds up to the next binade.
        codes = steps.astype(np.uint64) + (binade.astype(np.uint64) << self.fraction)
        if not self.subnormal:
            nearest = (magnitude > self.min_normal / 2).astype(np.uint64) << self.fraction
            codes = np.where(magnitude < self.min_normal, nearest, codes)
        return np.minimum(codes, self._code_max + (self.overflow == "infinity"))

    def decode(self, codes: np.ndarray) -> np.ndarray:
        """Return the values of codes, float64, exact."""
        codes = checked_codes(codes, self.width, str(self)).astype(np.uint64)
        hidden = 1 << self.fraction
        fraction = codes & (hidden - 1)
        biased = (codes >> self.fraction & ((1 << self.exponent) - 1)).astype(np.int32)
        steps = np.where(biased > 0, fraction + hidden, fraction * self.subnormal)
        exponent = np.maximum(biased, 1) - (self.bias + self.fraction)
        values = np.ldexp(steps.astype(np.float64), exponent)
        if self.overflow == "infinity":
            special = np.where(fraction == 0, np.inf, np.nan)
            values = np.where(biased == (1 << self.exponent) - 1, special, values)
        if self.signed:
            values = np.where(codes >> (self.width - 1), -values, values)
        # Only IEEE formats have −0; −0 + 0 = +0.
        return values if self.overflow == "infinity" else values + 0.0


FP16 = Float(5, 10, overflow="infinity")
"""IEEE 754 binary16, numpy's float16."""

FP24 = Float(7, 16, subnormal=False)
"""17 significant bits from 2^−62 to 2^65, saturating, one zero.

No subnormal values: they would enlarge a PE by a tenth, and no picture needs them.
"""
