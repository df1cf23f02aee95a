"""Binning in integers, as hardware and golden model compute it, and why no tile is missing.

A splat's outline is the ellipse dx = shear·dy ± slope·√(height² − dy²) around its centre (u, v),
|dy| ≤ height, |dx| ≤ width, rightmost at dy = lean, leftmost at −lean (`spec.programs`). It meets
the tiles of a tile row between the least and the largest dx in the row's band of dy, as both are
convex; and a function with one maximum takes it on a band as near to `lean` as the band comes. So
each end of a row is one value of the outline, at a band's end, or ± width.

**Units.** Heights and widths are integers of `LENGTH_BITS` bits in units of 2^e pixels, e chosen
for each splat and axis, at least −`FINEST` (1/32 pixel). Centre, lean and the image's size are in
these units too; n = e + FINEST is called the unit's step. With more than a tile to a unit a length
is *vast*: such a splat takes all rows (columns), and its box stands for its outline. A splat that
lies between the pixels of two rows counts as one row, without tiles.

    h = ⌊height / 2^e⌋ + 1 + slack          V ≤ v / 2^e ≤ V + 1          pixel = 2^−e (0 if e > 0)
    rows      (V − h + pixel − 1) >> s … (V + 1 + h) >> s,    s = −e + log2(tile)
    band      t0 = max((row << s) − V − 1, −h),   t1 = min(((row + 1) << s) − pixel − V, h)
    k         so that H = h << k has its highest bit set: what follows is as precise if h is small
    t         t0, t1 or none: where lean is beyond the band, by more than a margin, its end there
    r         ⌊√((H − |T|)·(H + |T|))⌋ + 1,    T = t << k
    end       ⌊(⌊shear'·T / 2^(f−g)⌋ + ⌊slope'·r / 2^(f−g)⌋) / 2^g⌋ + 1 + outward,
              or w if t is none
    columns   (U − left end + pixel − 1) >> s … (U + 1 + right end) >> s

shear' (towards 0) and slope' (up) are fixed-point numbers with f = `FACTOR_FRACTION` bits behind
the point, in horizontal units for each of the 2^(e−k): at most w / H, which is about 1. The left
end is the right end of the mirror image: bands −t1 … −t0.

**No tile is missing.** The record's numbers are off by a few roundings of the arithmetic, together
less than `ROUNDINGS` half steps of the height, the width and slope·height: `slack` units at most.
The outline only grows with h, slope' and r, which are all rounded up, and a band only reaches
farther; what remains is
 - shear', rounded by less than one step of 2^−f, a unit when multiplied by T < 2^f;
 - two products cut off at 2^−g;
 - lean. With dy = h·sin a the outline is w·cos(a − a0). By rounding shear' and slope' a0 turns by
   less than √2·2^−f·H/w; a band whose end is taken although a0 has come to lie inside makes that
   end too small by w·(1 − cos) of this, less than ⅔ unit, as w is 2 units or more. Where lean
   itself is rounded, and h has its slack, lean has to be beyond the band's end by the margin.
The sum is below `outward`. Measured: `tb/hdl/test_bin.py`.

**`Config.tile_test` "3sigma"** takes the original renderer's tiles instead: all in which a pixel's
centre lies in the square of half side radius = 3·√λmax around the splat's centre, where λmax is the
larger eigenvalue of the blurred covariance. (The original rounds the radius up to whole pixels, and
the square's right and lower ends down to the pixel before: `golden.reference.square_boxes`.)
Then h and w both are radius,
in one unit, and every end of a row is w. No tile of the square is missing for the same reason: the
radius is off by less than `ROUNDINGS` half steps. It is more tiles than the exact test takes, but
not all of those: of a splat whose opacity is above 255⁻¹·e^4.5, 0.35, the square cuts off the rim.
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
"""No unit is finer than 2^−this pixels."""

TILE_BITS = TILE.bit_length() - 1

STEP_MAX = FINEST + TILE_BITS
"""The coarsest unit, a tile, is this many doublings above the finest."""

FACTOR_FRACTION = 12
"""Bits of shear' and slope' behind the point; one more stands before it."""

GUARD = 3
"""Bits behind the point that are left of their products with T and r."""

ROUNDINGS = 8
"""Bound on the record's errors in half steps of its arithmetic."""

PAGE_BITS = 20
"""Width of a page's number: list memory of up to half a gigabyte."""


def slack(config: Config) -> int:
    """Units that the errors of a record's numbers can be worth."""
    return ceil(ROUNDINGS * 2.0 ** (LENGTH_BITS - 1 - config.arithmetic.fraction))


def outward(config: Config) -> int:
    """Units by which an end of a row is moved outwards."""
    return 2 + slack(config)


def lean_margin(config: Config) -> int:
    """Units by which lean may be beyond a band and still counts as inside."""
    return 2 + 2 * slack(config)


def position_bits(config: Config) -> int:
    """Bits of |u| or |v| in its unit; what needs more cannot touch the image."""
    side = config.side_max << FINEST
    return (side + (1 << HALF_BITS)).bit_length()


def groups_max(config: Config) -> int:
    """Most groups of an image, which decide whether it fits: those of the preset's own size."""
    rows, columns = group_grid(config, config.width_max, config.height_max)
    return rows * columns


def fits(config: Config, width: int, height: int) -> bool:
    """Whether a machine renders images of that many pixels."""
    rows, columns = group_grid(config, width, height)
    return max(width, height) <= config.side_max and rows * columns <= groups_max(config)


def bin_entry_record(config: Config) -> Record:
    """An entry on its way to its group's list."""
    bits = max(groups_max(config) - 1, 1).bit_length()
    return Record("bin_entry", {"group": Bits(bits), "entry": entry_record(config)})


def group_record() -> Record:
    """A group's list: its first page (meaningless without entries) and how many entries it has."""
    return Record("group", {"page": Bits(PAGE_BITS), "count": Bits(COUNT_BITS)})


def bursts_per_page(config: Config) -> int:
    """Bursts in a page; ValueError if they do not fill it."""
    bursts, rest = divmod(config.page, config.burst)
    if rest or bursts & (bursts - 1) or config.burst & (config.burst - 1):
        raise ValueError(f"{config.name}: page and burst are no powers of two, or page < burst")
    return bursts


def burst_record(config: Config) -> Record:
    """List slots to be written together; address: their place in list memory, in bursts, the number
    of their page and their place there.
    """
    address = Bits(PAGE_BITS + (bursts_per_page(config) - 1).bit_length())
    return Record("burst", {"address": address, "slots": Array(Bits(ENTRY_BITS), config.burst)})
