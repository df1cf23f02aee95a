"""Stage 3's numbers: from a splat and a tile to the colour of a pixel, all in integers.

For a splat and a tile, with X and Y a pixel's place from the tile's centre (7.5 pixels from the
centres of its first row and column),

    E(X, Y) = e + gx·X + gy·Y − cxx·X² + cxy·X·Y − cyy·Y²  =  log2(alpha)

`golden.setup` and `hdl.raster.setup` compute its coefficients: integers in units of
2^−`Config.exponent_fraction`. From there on E is a polynomial of integers. The centres of a tile's
blocks are at X = 2p, Y = 2q with p and q in −3, −1, 1, 3, and a block's pixels are as many half
pixels from its centre (`STEPS`): E and its slopes there need sums of shifted numbers only.

Lengths across the ellipse are divided by 2^k, lengths along it by 2^m, where k and m make the
conic's factors at least 1/2 and below 2. So all products have factors of few bits, for needles and
for splats larger than the image. A tile is too far away if a number leaves its range: if alpha
≥ 1/255 somewhere in a tile, E ≥ −413 at its centre, as E's curvature is at most 2.41 and the centre
is at most 10.7 pixels away; so √413 · √2 < 2^5 bounds a normalised length. Stage 1 limits the
curvature: no splat is thinner than the blur, even a needle, except for roundings (1 % with FP16's
digits); the numbers leave room for 10 %.

**The faintness rule** skips invisible contributions (`Config.faint`; 3DGS has no such rule). A
pixel with T < 2^−dark skips a splat that would take less than 2^−taken, and keeps T. A splat that
would leave less than 2^−ends takes all of T and ends the pixel. So skipped weight goes to the
splats behind, or in front: all weights still sum to 1, and only weights after T < 2^−dark differ.
The error of a pixel's colour is at most 2^−dark of the range of its colours.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.spec.axi import port_bytes
from splatcore.spec.colour import CHANNELS, COLOUR_INTEGER, colour_format
from splatcore.spec.config import Config
from splatcore.spec.convention import ALPHA_MAX, ALPHA_MIN, BLOCK, TILE, TRANSMITTANCE_MIN, Faint
from splatcore.spec.feature import FACTOR, POSITION, SCALE_MAX, SHEAR, feature_record
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits, Fixed
from splatcore.spec.record import Array, Format, Record
from splatcore.spec.work import PIXEL, pixel_bytes

BLOCKS = TILE // BLOCK
"""Blocks per side of a tile."""

STEPS = tuple(range(1 - BLOCKS, BLOCKS, 2))
"""−3, −1, 1, 3: centres of a tile's blocks in steps of 2 pixels, and of a block's pixels in steps
of half a pixel."""

SHIFT = Bits(6)
"""k, m and the shifts that follow from them, minus `SHIFT_MIN`."""

SHIFT_MIN = -16
"""Smallest shift: k and m are at least −1, scale is at most `SCALE_MAX`."""

LEAN_INTEGER = 14
"""Bits above the point of shear·dy, in units of 2^scale pixels; larger values are too far away."""

LENGTH_INTEGER = 5
"""Bits above the point of a normalised length."""

SLOPE = Fixed(2, 16, signed=True)
"""shear / 2^k: below √(2 · 2.41) by the blur."""

FACTOR_FRACTION = FACTOR.fraction + 1
"""Fraction bits of a normalised factor, enough to hold any factor exactly."""

MIXED_GUARD = 3
"""Additional fraction bits of factor·slope, from which E's second differences follow."""

EXPONENT_INTEGER = 9
"""Bits above the point of −E at a tile's centre."""

GRADIENT_INTEGER = 7
"""Bits above the point of E's slope at a tile's centre: at most 53 if the splat reaches the tile.
"""

CURVATURE_INTEGER = 3
"""Bits above the point of E's second differences."""

POWER_SHIFTS = 8
"""Halvings within the range of alpha: 1/255 > 2^−8."""

HALVING_BITS = (POWER_SHIFTS - 1).bit_length()
"""Width of a number of halvings."""


def mixed_shift(config: Config) -> int:
    """Return the right shift of the product of a factor and a slope."""
    return SLOPE.fraction + FACTOR_FRACTION - config.exponent_fraction - MIXED_GUARD


def lean_unit(config: Config) -> int:
    """Return the right shift that makes shear·dy a length, for a shear of exponent 0."""
    return SHEAR.fraction + POSITION.fraction - config.exponent_fraction


def prepared_record(config: Config) -> Record:
    """A splat prepared for setup, the same for all tiles.

    u, v, scale: its centre
    across, along: normalised factors
    k, m: powers of two by which lengths are divided
    across_shift, along_shift: k − scale, m − scale
    shear, lean_shift: significand; right shift that makes its product with dy a length
    slope: shear / 2^k
    cxx, cxy, cyy: E's second differences
    """
    factor = Bits(FACTOR_FRACTION + 1)
    fields = {"u": POSITION, "v": POSITION, "scale": Bits(SCALE_MAX.bit_length())}
    fields |= {"across": factor, "along": factor, "k": SHIFT, "m": SHIFT}
    fields |= {"across_shift": SHIFT, "along_shift": SHIFT, "lean_shift": SHIFT}
    fields |= {"shear": Bits(SHEAR.fraction + 2), "slope": SLOPE}
    fields |= curvature_formats(config) | {"opacity": OPACITY}
    return Record("prepared", fields | colours(config))


def curvature_formats(config: Config) -> dict[str, Fixed]:
    """E's second differences."""
    format = Fixed(CURVATURE_INTEGER, config.exponent_fraction)
    return {"cxx": format, "cxy": replace(format, signed=True), "cyy": format}


def quadratic_record(config: Config) -> Record:
    """E's coefficients; all except cxx and cyy are signed."""
    integers = {"e": EXPONENT_INTEGER, "gx": GRADIENT_INTEGER, "gy": GRADIENT_INTEGER}
    fraction = config.exponent_fraction
    plane = {name: Fixed(integer, fraction, signed=True) for name, integer in integers.items()}
    return Record("quadratic", plane | curvature_formats(config))


def tile_format(config: Config) -> Bits:
    """A tile's number in its group."""
    return Bits(max((config.group**2 - 1).bit_length(), 1))


SUM_INTEGER = COLOUR_INTEGER + 1
"""Bits above the point of a pixel's colour, a mean of colours: rounding up adds less than
2^(weight − sum_fraction)."""

GROUP_BITS = 6
"""Bits of a group's number by which parts of stage 3 compare their groups: enough for all ends of
groups in flight between them."""

COLOURS = CHANNELS
"""A splat's colour channels."""


def colours(config: Config) -> dict[str, Fixed]:
    """A splat's colour."""
    return dict.fromkeys(COLOURS, colour_format(config))


def featured_record(config: Config) -> Record:
    """The input of stage 3: a splat and its tiles of the group, or (end 1) a group's end."""
    tiles = {"mask": Bits(config.group**2), "end": Bits(1)}
    return Record("featured", {"splat": feature_record(config)} | tiles)


def readied_record(config: Config) -> Record:
    """The same with the prepared splat."""
    return Record("readied", dict(featured_record(config).fields, splat=prepared_record(config)))


def position_record(config: Config) -> Record:
    """A group's position in the image, in groups."""
    return Record("position", _place(config, TILE * config.group))


def _place(config: Config, side: int) -> dict[str, Bits]:
    """Column and row in the image of a square of `side` × `side` pixels."""
    bits = Bits(max(((config.side_max - 1) // side).bit_length(), 1))
    return {"column": bits, "row": bits}


def pair_record(config: Config) -> Record:
    """A splat and one of its tiles: the tile's place in the image, in tiles, and in the group."""
    tile = {"tile": tile_format(config), "end": Bits(1)}
    return Record("pair", {"splat": prepared_record(config)} | _place(config, TILE) | tile)


def around_record(config: Config) -> Record:
    """E around a tile; far: the tile is too far away."""
    fields = {"quadratic": quadratic_record(config), "far": Bits(1), "tile": tile_format(config)}
    return Record("around", fields | colours(config) | {"end": Bits(1)})


def marked_record(config: Config, blocks: Format) -> Record:
    """A pair and the blocks that it may reach: of one rasterizer, or by level (`mark_min`)."""
    fields = {"quadratic": quadratic_record(config), "tile": tile_format(config)}
    fields |= {"blocks": blocks}
    return Record("marked", fields | colours(config) | {"end": Bits(1)})


def pixels_record(config: Config) -> Record:
    """A finished block: its pixels row by row, with alpha if the machine can write it."""
    pixel = Array(Bits(8), pixel_bytes(config.rgba))
    return Record("pixels", {"pixels": Array(pixel, BLOCK**2)})


def exponent_min(fraction: int) -> int:
    """Return the lowest E with alpha ≥ 1/255, in units of 2^−fraction."""
    return int(np.ceil(np.log2(ALPHA_MIN) * 2.0**fraction))


def mark_roundings(config: Config) -> int:
    """Upper bound of the rounding error of a pixel's E, in units of 2^−exponent_fraction."""
    most = max(STEPS)
    roundings = 2 * most + 3 * most**2  # of its slopes and second differences
    finer = config.exponent_fraction - config.pixel_fraction
    return roundings << max(finer, 0)


def mark_min(config: Config) -> tuple[int, ...]:
    """Marking thresholds of E, one per block level, in units of 2^−exponent_fraction. A block has
    level 0 while any pixel has T ≥ 2^−dark (`Config.faint`), and level k once all have
    T < 2^−(dark + k − 1).

    With T < 2^−t a splat takes less than 2^−taken if alpha < 2^−(taken − t). Alpha 1/255 is taken
    as 2^−8, so that all thresholds differ by whole numbers.
    """
    least = [-POWER_SHIFTS]
    if rule := config.faint:
        least += [max(t - rule.taken, -POWER_SHIFTS) for t in range(rule.dark, rule.ends)]
    fraction = config.exponent_fraction
    return tuple((e << fraction) - mark_roundings(config) for e in least)


@cache
def power_table(config: Config) -> tuple[int, ...]:
    """2^x in units of 2^−power_mantissa for x from −1 to 0, at the middle of each step, limited to
    the largest alpha. All are less than 1, and none less than 1/2.
    """
    steps = 1 << config.power_fraction
    values = 2.0 ** ((np.arange(steps) + 0.5) / steps - 1)
    values = np.rint(np.minimum(values, ALPHA_MAX) * 2.0**config.power_mantissa)
    return tuple(min(int(value), (1 << config.power_mantissa) - 1) for value in values)


def transmittance_min(config: Config) -> int:
    """Return the T below which a pixel ends, or all of T is taken; 0 if pixels never end."""
    if not config.early_termination:
        return 0
    if config.faint:
        return 1 << config.transmittance - config.faint.ends
    return int(np.ceil(TRANSMITTANCE_MIN * 2.0**config.transmittance))


def faint_rule(config: Config) -> Faint | None:
    """Return a machine's faintness rule for `Convention`, or None."""
    return Faint(*(2.0**-places for places in config.faint)) if config.faint else None


def owner(config: Config, block: int) -> int:
    """Return the rasterizer of a tile's block. Neighbours go to different rasterizers, so that a
    small splat keeps several of them busy.
    """
    (row, column), columns = divmod(block, BLOCKS), span_blocks(config)
    return (column + row) % columns + columns * (row % (config.rasterizers // columns))


def block_count(config: Config) -> int:
    """Return the blocks per group that a rasterizer owns."""
    return config.group**2 * BLOCKS**2 // config.rasterizers


def owned(config: Config, rasterizer: int) -> list[int]:
    """Return a rasterizer's blocks of a tile, in the order of their numbers there."""
    return [block for block in range(BLOCKS**2) if owner(config, block) == rasterizer]


def span_blocks(config: Config) -> int:
    """Return the blocks per span: neighbours in a row, written together, one of each rasterizer."""
    return min(config.rasterizers, BLOCKS)


def spans_meet(config: Config) -> bool:
    """Whether two neighbouring spans fill beats of the port and share one of them. Then they are
    written one after the other, and the first waits with its part of that beat. Spans with alpha
    never share one: they have 16, 32 or 64 bytes.
    """
    size, beat = span_blocks(config) * BLOCK * PIXEL, port_bytes(config)
    several = config.group * BLOCKS > span_blocks(config)
    return several and size > beat and size % beat != 0 and 2 * size % beat == 0


def tiles_meet(config: Config) -> bool:
    """Whether two such spans are rows of two tiles' blocks."""
    return spans_meet(config) and span_blocks(config) == BLOCKS


def nth_block(config: Config, number: int):
    """Return which of a rasterizer's blocks of a group, tile after tile, is output as number
    `number`; of integers or hardware values. If two neighbouring tiles share beats of the port
    (`tiles_meet`), their rows of blocks follow each other.
    """
    if not tiles_meet(config):
        return number
    own = BLOCKS**2 // config.rasterizers
    bits = own.bit_length() - 1
    second, block, tiles = number & 1, number >> 1 & own - 1, number >> 1 + bits
    return block | second << bits | tiles << bits + 1
