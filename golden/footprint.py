"""Golden model of binning, first half: the tiles that each splat touches, in the integers of
`spec.binning`.
"""

import numpy as np
from numba import njit

from splatcore.golden.arithmetic import Parts, take_apart
from splatcore.golden.batches import in_batches
from splatcore.spec import binning
from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.number import Float

Codes = dict[str, np.ndarray]


def fixed(format: Float, parts: Parts, power: np.ndarray, bits: int) -> tuple:
    """Return ⌊significand · 2^(exponent + power − fraction)⌋, else 0, and whether it fits."""
    before = max(0, bits - format.fraction - 1)
    amount = format.fraction + before - parts.exponent - power
    fits = parts.exponent + power < bits
    number = parts.significand << before >> np.clip(amount, 0, 63)
    return np.where(fits, number, 0), fits


AXIS = np.dtype(
    [(name, np.int64) for name in "step vast half centre limit pixel shift seen".split()]
)
"""One axis of a splat, in units of 2^(step − FINEST) pixels.

step: doublings from the finest unit
vast: the splat covers the whole image
half: half of the splat's width or height
centre: the splat's centre
limit: the last pixel's centre
pixel: units per pixel, 0 if the unit is larger
shift: log2 of the units per tile
seen: the splat's box overlaps the image
"""

OUTLINE = np.dtype(
    [("x", AXIS), ("y", AXIS)]
    + [(name, np.int64) for name in "box shear slope lean normalise between first last".split()]
)
"""A splat as `visit` takes it.

x, y: its axes
box: its outline is a box, not an ellipse
shear, slope, lean, normalise: shear', slope', lean and k of `spec.binning`
between: it is between two rows of pixels
first, last: tile rows
"""


def axis(config: Config, length: Parts, centre: Parts, size: int) -> np.ndarray:
    """Return `AXIS` of splats [N], each in its own unit.

    length: [N] half of their width or height, `Config.arithmetic`
    centre: [N] u or v, `Config.arithmetic`
    size: width or height of the image, pixels
    """
    format = config.arithmetic
    finest = config.screen_exponent + binning.FINEST
    found = np.zeros(len(length.exponent), AXIS)
    step = np.maximum(length.exponent + finest + 1 - binning.LENGTH_BITS, 0)
    found["vast"] = vast = step > binning.STEP_MAX
    found["step"] = step = np.minimum(step, binning.STEP_MAX)
    found["shift"] = binning.STEP_MAX - step
    half, _ = fixed(format, length, finest - step, binning.LENGTH_BITS)
    found["half"] = half = half + 1 + binning.slack(config)
    magnitude, near = fixed(format, centre, finest - step, binning.position_bits(config))
    found["centre"] = centre = np.where(centre.negative, ~magnitude, magnitude)
    found["limit"] = limit = ((size - 1 << binning.FINEST) >> step) + (step > binning.FINEST)
    found["pixel"] = (1 << binning.FINEST) >> step
    found["seen"] = vast | near & (centre - half <= limit) & (centre + 1 + half >= 0)
    return found


def factor(config: Config, parts: Parts, power: np.ndarray) -> np.ndarray:
    """Return a ratio times 2^power with `FACTOR_FRACTION` bits, towards 0, at most just below 2."""
    bits = binning.FACTOR_FRACTION + 1
    found, fits = fixed(config.arithmetic, parts, power + binning.FACTOR_FRACTION, bits)
    return np.where(fits, found, (1 << bits) - 1)


def outlines(config: Config, codes: Codes, width: int, height: int) -> np.ndarray:
    """Return `OUTLINE` of splats [N].

    codes: [N] codes of `splat_record`
    width, height: image size, pixels
    A splat outside the image, or without extent, has no rows.
    """
    part = {name: take_apart(config.arithmetic, codes[name]) for name in codes}
    square = config.tile_test == "3sigma"
    lengths = ("radius", "radius") if square else ("half_width", "half_height")
    found = np.zeros(len(codes["u"]), OUTLINE)
    found["x"] = x = axis(config, part[lengths[0]], part["u"], width)
    found["y"] = y = axis(config, part[lengths[1]], part["v"], height)
    first = np.maximum((y["centre"] - y["half"] + y["pixel"] - 1) >> y["shift"], 0)
    last = np.minimum((y["centre"] + 1 + y["half"]) >> y["shift"], (height - 1) // TILE)
    first, last = np.where(y["vast"], 0, first), np.where(y["vast"], (height - 1) // TILE, last)
    found["between"] = first > last  # one row is visited
    found["first"] = first
    seen = x["seen"] & y["seen"]
    if config.compensates:  # an opacity below 1/255 makes the square of the extent negative
        seen = seen & ~part["half_width"].negative.astype(bool)
    found["last"] = np.where(seen, np.maximum(first, last), first - 1)
    found["box"] = y["vast"] | square
    if not square:
        add_ellipse(config, part, found)
    return found


def add_ellipse(config: Config, part: dict[str, Parts], found: np.ndarray):
    """Write the fields of `OUTLINE` for ellipses: shear, slope, lean, normalise."""
    x, y = found["x"], found["y"]
    found["normalise"] = binning.HALF_BITS - np.frexp(y["half"].astype(np.float64))[1]
    finer = y["step"] - found["normalise"] - x["step"]
    shear = factor(config, part["shear"], finer)
    power = config.screen_exponent + binning.FINEST - y["step"]
    lean, fits = fixed(config.arithmetic, part["lean"], power, binning.HALF_BITS)
    lean = np.where(fits, lean, (1 << binning.HALF_BITS) - 1)
    found["shear"] = np.where(part["shear"].negative, -shear, shear)
    found["slope"] = factor(config, part["slope"], finer) + 1
    found["lean"] = np.where(part["lean"].negative, -lean, lean)


@njit(cache=True)
def right_end(o, low, high, sign, margin, out):
    """Return the right end of an outline in a band (sign 1), or of the mirrored outline (−1)."""
    if sign < 0:
        low, high = -high, -low
    if low - margin <= o.lean <= high + margin:
        return o.x.half
    t = (high if o.lean > high else low) << o.normalise
    half = o.y.half << o.normalise
    root = np.int64(np.sqrt(np.float64((half - abs(t)) * (half + abs(t))))) + 1
    cut = binning.FACTOR_FRACTION - binning.GUARD
    return ((o.shear * t >> cut) + (o.slope * root >> cut) >> binning.GUARD) + 1 + out


@njit(cache=True)
def row_columns(o, row, last_column, margin, out):
    """Return the first and last tile column in a row; first > last if it has none."""
    x, y = o.x, o.y
    if o.between:
        return 1, 0
    if x.vast:
        return 0, last_column
    low = max((row << y.shift) - y.centre - 1, -y.half)
    high = min(min(((row + 1) << y.shift) - y.pixel, y.limit) - y.centre, y.half)
    right = left = x.half
    if not o.box:
        right = right_end(o, low, high, 1, margin, out)
        left = right_end(o, low, high, -1, margin, out)
    first = (x.centre - left + x.pixel - 1) >> x.shift
    last = min((x.centre + 1 + right) >> x.shift, last_column)
    return (max(first, 0), last) if x.centre - left <= x.limit else (last + 1, last)


@njit(nogil=True, cache=True)
def visit(outlines, group, last_column, margin, out, entries):
    """Write the entries of splats; return their number.

    outlines: [N] of `OUTLINE`
    entries: [E, 3] splat, group as row · 2^16 + column, mask; only counts if it has no rows
    """
    count = 0
    begins, ends = np.empty(group, np.int64), np.empty(group, np.int64)
    for splat in range(len(outlines)):
        o = outlines[splat]
        least, most = 1 << 30, -1
        begins[:], ends[:] = 1, 0
        for row in range(o.first, o.last + 1):
            begin, end = row_columns(o, row, last_column, margin, out)
            begins[row % group], ends[row % group] = begin, end
            if begin <= end:
                least, most = min(least, begin // group), max(most, end // group)
            if row % group < group - 1 and row < o.last:
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
    """Return entries [E, 3] of splats [N] as `visit` writes them, and their tile rows [N]."""
    rest = config.group, (width - 1) // TILE, binning.lean_margin(config), binning.outward(config)

    def of(batch: slice) -> tuple[np.ndarray, np.ndarray]:
        part = {name: code[batch] for name, code in codes.items()}
        found = outlines(config, part, width, height)
        entries = np.empty((visit(found, *rest, np.empty((0, 3), np.int64)), 3), np.int64)
        if len(entries):
            visit(found, *rest, entries)
            entries[:, 0] += batch.start
        return entries, found["last"] - found["first"] + 1

    entries, rows = zip(*in_batches(of, len(codes["u"])), strict=True)
    return np.concatenate(entries), np.concatenate(rows)
