"""Binning's twin, first half: splats to the tiles that they touch, in the integers of
`spec.binning`.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from splatcore.spec.binning import (
    FACTOR_FRACTION,
    FINEST,
    GUARD,
    HALF_BITS,
    LENGTH_BITS,
    STEP_MAX,
    lean_margin,
    outward,
    position_bits,
    slack,
)
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.number import Float

Codes = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Parts:
    """Floats taken apart: (−1)^negative · significand · 2^(exponent − fraction), int64 [N]."""

    negative: np.ndarray
    exponent: np.ndarray
    significand: np.ndarray

    @classmethod
    def of(cls, format: Float, codes: np.ndarray) -> "Parts":
        """An infinity is as a power of two above all numbers, a NaN as some larger number."""
        codes = codes.astype(np.int64)
        fraction = codes & ((1 << format.fraction) - 1)
        biased = codes >> format.fraction & ((1 << format.exponent) - 1)
        zero = biased == 0
        significand = np.where(zero, fraction * format.subnormal, fraction | 1 << format.fraction)
        exponent = np.where(zero & format.subnormal, 1, biased) - format.bias
        return cls(codes >> (format.width - 1), exponent, significand)


def fixed(format: Float, parts: Parts, power: np.ndarray, bits: int) -> tuple:
    """⌊significand · 2^(exponent + power − fraction)⌋, and whether its bits suffice (else 0)."""
    before = max(0, bits - format.fraction - 1)
    amount = format.fraction + before - parts.exponent - power
    fits = parts.exponent + power < bits
    number = parts.significand << before >> np.clip(amount, 0, 63)
    return np.where(fits, number, 0), fits


@dataclass(frozen=True, eq=False)
class Axis:
    """One axis of splats [N]: int64, in units of 2^(step − FINEST) pixels."""

    step: np.ndarray
    vast: np.ndarray
    half: np.ndarray  # h, w
    centre: np.ndarray  # V, U
    limit: np.ndarray  # of the last pixel's centre
    pixel: np.ndarray
    seen: np.ndarray  # whether the box and the image have something in common

    @property
    def shift(self) -> np.ndarray:
        """log2 of a tile's units."""
        return STEP_MAX - self.step


def axis(config: Config, length: Parts, centre: Parts, size: int) -> Axis:
    """Lengths and places of one axis in each splat's unit; size: of the image, in pixels."""
    format = config.arithmetic
    finest = config.screen_exponent + FINEST
    step = np.maximum(length.exponent + finest + 1 - LENGTH_BITS, 0)
    vast = step > STEP_MAX
    step = np.minimum(step, STEP_MAX)
    half, _ = fixed(format, length, finest - step, LENGTH_BITS)
    half = half + 1 + slack(config)
    magnitude, near = fixed(format, centre, finest - step, position_bits(config))
    centre = np.where(centre.negative, ~magnitude, magnitude)
    limit = ((size - 1 << FINEST) >> step) + (step > FINEST)
    pixel = (1 << FINEST) >> step
    seen = near & (centre - half <= limit) & (centre + 1 + half >= 0)
    return Axis(step, vast, half, centre, limit, pixel, seen | vast)


def factor(config: Config, parts: Parts, power: np.ndarray) -> np.ndarray:
    """A ratio times 2^power with `FACTOR_FRACTION` bits, towards 0, at most just below 2."""
    bits = FACTOR_FRACTION + 1
    found, fits = fixed(config.arithmetic, parts, power + FACTOR_FRACTION, bits)
    return np.where(fits, found, (1 << bits) - 1)


@dataclass(frozen=True, eq=False)
class Outlines:
    """What `visit` needs of splats [N]: columns of int64."""

    columns: np.ndarray  # [N, 19]
    first: np.ndarray  # [N] first and last tile row
    last: np.ndarray


def outlines(config: Config, codes: Codes, width: int, height: int) -> Outlines:
    """Set-up of splats with the codes [N] of a `splat_record`, on an image of that size.

    A splat whose box is beside the image has no rows.
    """
    part = {name: Parts.of(config.arithmetic, codes[name]) for name in codes}
    square = config.tile_test == "3sigma"
    lengths = ("radius", "radius") if square else ("half_width", "half_height")
    x = axis(config, part[lengths[0]], part["u"], width)
    y = axis(config, part[lengths[1]], part["v"], height)
    first = np.maximum((y.centre - y.half + y.pixel - 1) >> y.shift, 0)
    last = np.minimum((y.centre + 1 + y.half) >> y.shift, (height - 1) // TILE)
    first, last = np.where(y.vast, 0, first), np.where(y.vast, (height - 1) // TILE, last)
    between = first > last  # of two rows' pixels: one row is looked at
    last = np.where(x.seen & y.seen, np.maximum(first, last), first - 1)
    curve = [np.zeros_like(first)] * 4 if square else ellipse(config, part, x, y)
    columns = [
        x.half, x.centre, x.limit, x.pixel, x.shift, x.vast,
        y.half, y.centre, y.limit, y.pixel, y.shift, y.vast | square,
        *curve, between, first, last,
    ]  # fmt: skip
    return Outlines(np.stack(columns, axis=1), first, last)


def ellipse(config: Config, part: dict[str, Parts], x: Axis, y: Axis) -> list[np.ndarray]:
    """Columns of int64 [N] that make an outline of a box: shear', slope', lean, k."""
    normalise = HALF_BITS - np.frexp(y.half.astype(np.float64))[1].astype(np.int64)
    finer = y.step - normalise - x.step
    shear = factor(config, part["shear"], finer)
    lean, fits = fixed(
        config.arithmetic, part["lean"], config.screen_exponent + FINEST - y.step, HALF_BITS
    )
    lean = np.where(fits, lean, (1 << HALF_BITS) - 1)
    return [
        np.where(part["shear"].negative, -shear, shear),
        factor(config, part["slope"], finer) + 1,
        np.where(part["lean"].negative, -lean, lean),
        normalise,
    ]


@njit(cache=True)
def right_end(outline, low, high, sign, margin, out):
    """The right end of a band's part of the outline (sign 1), or of the mirrored outline's (−1)."""
    half_width, half, shear, slope, lean, normalise = outline
    if sign < 0:
        low, high = -high, -low
    if low - margin <= lean <= high + margin:
        return half_width
    t = (high if lean > high else low) << normalise
    half <<= normalise
    root = np.int64(np.sqrt(np.float64((half - abs(t)) * (half + abs(t))))) + 1
    cut = FACTOR_FRACTION - GUARD
    return ((shear * t >> cut) + (slope * root >> cut) >> GUARD) + 1 + out


@njit(cache=True)
def row_columns(o, row, last_column, margin, out):
    """First and last column of tiles of a row; the first is beyond the last if there is none."""
    half_width, u, limit_x, pixel_x, shift_x, vast_x = o[:6]
    half, v, limit_y, pixel_y, shift_y, box = o[6:12]
    if o[16]:
        return 1, 0
    if vast_x:
        return 0, last_column
    low = max((row << shift_y) - v - 1, -half)
    high = min(min(((row + 1) << shift_y) - pixel_y, limit_y) - v, half)
    outline = (half_width, half, o[12], o[13], o[14], o[15])
    right = left = half_width
    if not box:
        right = right_end(outline, low, high, 1, margin, out)
        left = right_end(outline, low, high, -1, margin, out)
    first = (u - left + pixel_x - 1) >> shift_x
    last = min((u + 1 + right) >> shift_x, last_column)
    return (max(first, 0), last) if u - left <= limit_x else (last + 1, last)


@njit(cache=True)
def visit(columns, group, last_column, margin, out, entries):
    """Entries [E, 3] (splat, group's row and column in one number, mask) and how many there are.

    Counts only if `entries` has no rows. Columns are those of `Outlines`; a group's number here is
    row · 2^16 + column.
    """
    count = 0
    begins, ends = np.empty(group, np.int64), np.empty(group, np.int64)
    for splat in range(len(columns)):
        o = columns[splat]
        least, most = 1 << 30, -1
        begins[:], ends[:] = 1, 0
        for row in range(o[17], o[18] + 1):
            begin, end = row_columns(o, row, last_column, margin, out)
            begins[row % group], ends[row % group] = begin, end
            if begin <= end:
                least, most = min(least, begin // group), max(most, end // group)
            if row % group < group - 1 and row < o[18]:
                continue
            for column in range(least, most + 1):
                mask = 0
                for k in range(group * group):
                    place = column * group + k % group
                    mask |= (begins[k // group] <= place <= ends[k // group]) << k
                if mask:
                    if len(entries):
                        entries[count] = splat, (row // group << 16) + column, mask
                    count += 1
            least, most = 1 << 30, -1
            begins[:], ends[:] = 1, 0
    return count


def footprints(config: Config, codes: Codes, width: int, height: int):
    """Entries [E, 3] of splats [N] as `visit` gives them, and tile rows [N] that are looked at."""
    found = outlines(config, codes, width, height)
    rest = (
        config.group, (width - 1) // TILE, lean_margin(config), outward(config)
    )  # fmt: skip
    count = visit(found.columns, *rest, np.empty((0, 3), np.int64))
    entries = np.empty((count, 3), np.int64)
    if count:
        visit(found.columns, *rest, entries)
    return entries, found.last - found.first + 1
