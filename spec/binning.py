"""Binning in integers, as hardware and golden model compute it, and why no tile is missing.

A splat's outline is the ellipse dx = shear·dy ± slope·√(height² − dy²) around its centre (u, v),
|dy| ≤ height, |dx| ≤ width, rightmost at dy = lean, leftmost at −lean (`spec.programs`). In a tile
row it meets the tiles between its smallest and its largest dx in the row's band of dy, as both are
convex. A function with a single maximum takes its maximum on a band at the point nearest to `lean`.
So each end of a row is one value of the outline at an end of the band, or ± width.

**Units.** Heights and widths are integers of `LENGTH_BITS` bits in units of 2^e pixels, e chosen
for each splat and axis, at least −`FINEST` (1/32 pixel). Centre, lean and the image's size are in
these units too; n = e + FINEST is called the unit's step. If a unit is larger than a tile, a length
is *vast*: such a splat takes all rows (columns), and its box stands for its outline. A splat
between the pixels of two rows counts as one row, without tiles.

    h = ⌊height / 2^e⌋ + 1 + slack          V ≤ v / 2^e ≤ V + 1          pixel = 2^−e (0 if e > 0)
    rows      (V − h + pixel − 1) >> s … (V + 1 + h) >> s,    s = −e + log2(tile)
    band      t0 = max((row << s) − V − 1, −h),   t1 = min(((row + 1) << s) − pixel − V, h)
    k         so that H = h << k has its highest bit set: the next steps are as precise for small h
    t         t0 or t1, the end nearer to lean, if lean is outside the band by more than a margin;
              else none
    r         ⌊√((H − |T|)·(H + |T|))⌋ + 1,    T = t << k
    end       ⌊(⌊shear'·T / 2^(f−g)⌋ + ⌊slope'·r / 2^(f−g)⌋) / 2^g⌋ + 1 + outward,
              or w if t is none
    columns   (U − left end + pixel − 1) >> s … (U + 1 + right end) >> s

shear' (towards 0) and slope' (up) are fixed-point numbers with f = `FACTOR_FRACTION` bits below
the point, in horizontal units per 2^(e−k) pixels downwards: at most w / H, which is about 1. The
left end is the right end of the mirror image: bands −t1 … −t0.

**No tile is missing.** The record's numbers are off by a few roundings of the arithmetic, together
less than `ROUNDINGS` half steps of the height, the width and slope·height: `slack` units at most.
The outline only grows with h, slope' and r, which are all rounded up, and a band only reaches
farther. The remaining errors are
 - shear', rounded by less than one step of 2^−f: a unit when multiplied by T < 2^f;
 - two products cut off at 2^−g;
 - lean. With dy = h·sin a the outline is w·cos(a − a0). Rounding shear' and slope' turns a0 by
   less than √2·2^−f·H/w. If a band's end is taken although a0 has moved inside, that end is too
   small by w·(1 − cos) of this angle, less than ⅔ unit, as w is 2 units or more. As lean itself is
   rounded, and h has its slack, lean must be outside the band by the margin.
The sum is below `outward`. Measured: `tb/hdl/test_bin.py`.

**`Config.tile_test` "3sigma"** takes the original renderer's tiles instead: all tiles with a pixel
centre in the square of half side radius = 3·√λmax around the splat's centre, where λmax is the
larger eigenvalue of the blurred covariance. (The original rounds the radius up to whole pixels, and
the square's right and lower ends down to the pixel before: `golden.reference.square_boxes`.)
Then h and w both are the radius, in one unit, and every end of a row is w. No tile of the square is
missing for the same reason: the radius is off by less than `ROUNDINGS` half steps. The square takes
more tiles than the exact test, but misses some of its tiles: it cuts off the rim of splats with an
opacity above 255⁻¹·e^4.5 = 0.35.
"""

from math import ceil

from splatcore.spec.config import Config
from splatcore.spec.convention import TILE
from splatcore.spec.group import COUNT_BITS, ENTRY_BITS, entry_record, group_grid
from splatcore.spec.number import Bits
from splatcore.spec.record import Array, Record

LENGTH_BITS = 11
"""Bits of a length in its unit, before slack is added."""

HALF_BITS = LENGTH_BITS + 1
"""Bits of half a splat's height or width, slack included."""

FINEST = 5
"""The finest unit is 2^−FINEST pixels."""

TILE_BITS = TILE.bit_length() - 1
"""log2 of a tile's side in pixels."""

STEP_MAX = FINEST + TILE_BITS
"""Doublings from the finest unit to the coarsest, which is a tile."""

FACTOR_FRACTION = 12
"""Bits of shear' and slope' below the point; one more bit is above it."""

GUARD = 3
"""Bits kept below the point of their products with T and r."""

ROUNDINGS = 8
"""Bound on the errors of the record's numbers, in half steps of its arithmetic."""

PAGE_BITS = 20
"""Width of a page's number: up to half a gigabyte of list memory."""


def slack(config: Config) -> int:
    """Return the errors of a record's numbers, in units of a length."""
    return ceil(ROUNDINGS * 2.0 ** (LENGTH_BITS - 1 - config.arithmetic.fraction))


def outward(config: Config) -> int:
    """Return by how many units an end of a row is moved outwards."""
    return 2 + slack(config)


def lean_margin(config: Config) -> int:
    """Return by how many units lean may be outside a band and still count as inside."""
    return 2 + 2 * slack(config)


def position_bits(config: Config) -> int:
    """Return the bits of |u| or |v| in its unit; a larger centre cannot touch the image."""
    side = config.side_max << FINEST
    return (side + (1 << HALF_BITS)).bit_length()


def groups_max(config: Config) -> int:
    """Return the maximum number of groups per image: the groups of the preset's own size."""
    rows, columns = group_grid(config, config.width_max, config.height_max)
    return rows * columns


def fits(config: Config, width: int, height: int) -> bool:
    """Return whether a machine renders images of width × height pixels."""
    rows, columns = group_grid(config, width, height)
    return max(width, height) <= config.side_max and rows * columns <= groups_max(config)


def bin_entry_record(config: Config) -> Record:
    """An entry and the number of the group whose list it joins."""
    bits = max(groups_max(config) - 1, 1).bit_length()
    return Record("bin_entry", {"group": Bits(bits), "entry": entry_record(config)})


def group_record() -> Record:
    """A group's list.

    page: its first page; meaningless if the list is empty
    count: number of entries
    """
    return Record("group", {"page": Bits(PAGE_BITS), "count": Bits(COUNT_BITS)})


def bursts_per_page(config: Config) -> int:
    """Return the bursts per page; raise ValueError if they do not fill a page."""
    bursts, rest = divmod(config.page, config.burst)
    if rest or bursts & (bursts - 1) or config.burst & (config.burst - 1):
        raise ValueError(f"{config.name}: page and burst must be powers of two, page ≥ burst")
    return bursts


def burst_record(config: Config) -> Record:
    """List slots to be written together.

    address: place in list memory, in bursts: the page's number, then the place in the page
    slots: the entries
    """
    address = Bits(PAGE_BITS + (bursts_per_page(config) - 1).bit_length())
    return Record("burst", {"address": address, "slots": Array(Bits(ENTRY_BITS), config.burst)})
