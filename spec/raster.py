"""Stage 3's numbers: from a splat and a tile to the colour of a pixel, all in integers.

For a splat and a tile, with X and Y a pixel's place from the tile's centre (7.5 pixels from the
centres of its first row and column),

    E(X, Y) = e + gx·X + gy·Y − cxx·X² + cxy·X·Y − cyy·Y²  =  log2(alpha)

`golden.setup` and `hdl.raster.setup` make its coefficients: integers in units of
2^−`Config.exponent_fraction`. From there on E is a polynomial of integers. The centres of a tile's
blocks are at X = 2p, Y = 2q with p and q in −3, −1, 1, 3, and a block's pixels are as many half
pixels from its centre (`STEPS`): E and its slopes there need sums of shifted numbers only.

Lengths across the ellipse are divided by 2^k, those along it by 2^m, where k and m make the conic's
factors at least 1/2 and below 2. So all products have factors of few bits, for needles and for
splats larger than the image. A tile for which a number leaves its range is too far away: where
alpha ≥ 1/255 somewhere in a tile, E ≥ −413 at its centre, as E's curvature is at most 2.41 and the
centre is at most 10.7 pixels away; so √413 · √2 < 2^5 bounds a normalised length. Stage 1 sees to
the curvature: no splat is thinner than the blur, whatever is lost of a needle, but for roundings,
1 % with FP16's digits; there is room for 10 %.

**What is too faint to be seen** is not computed (`Config.faint`, (a, b, c); 3DGS has no such rule):
a pixel with T < 2^−a skips a splat that would take less than 2^−b, T unchanged, and a splat that
would leave less than 2^−c takes all of T and ends the pixel. So what is left out goes to what lies
behind, or in front: all weights still sum to 1, and only those that come once T < 2^−a differ. The
colour of a pixel is wrong by 2^−a of the range of its colours at most.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from splatcore.spec.axi import port_bytes
from splatcore.spec.colour import CHANNELS, COLOUR_INTEGER, colour_format
from splatcore.spec.config import Config
from splatcore.spec.convention import ALPHA_MAX, ALPHA_MIN, BLOCK, TILE, TRANSMITTANCE_MIN
from splatcore.spec.feature import FACTOR, POSITION, SCALE_MAX, SHEAR, feature_record
from splatcore.spec.memory import OPACITY
from splatcore.spec.number import Bits, Fixed
from splatcore.spec.record import Array, Format, Record
from splatcore.spec.work import PIXEL

BLOCKS = TILE // BLOCK
"""Blocks along the side of a tile."""

STEPS = tuple(range(1 - BLOCKS, BLOCKS, 2))
"""−3, −1, 1, 3: centres of a tile's blocks in steps of 2 pixels, and of a block's pixels in steps
of half a pixel."""

SHIFT = Bits(6)
"""k, m and shifts that follow from them, from `SHIFT_MIN` on."""

SHIFT_MIN = -16
"""No shift is below: k and m are at least −1, scale is at most `SCALE_MAX`."""

LEAN_INTEGER = 14
"""Bits before the point of shear·dy, in units of 2^scale pixels; what is more is too far away."""

LENGTH_INTEGER = 5
"""Bits before the point of a normalised length."""

SLOPE = Fixed(2, 16, signed=True)
"""shear / 2^k: below √(2 · 2.41) by the blur."""

FACTOR_FRACTION = FACTOR.fraction + 1
"""Bits below the point of a normalised factor, which so holds any factor exactly."""

MIXED_GUARD = 3
"""Bits of factor·slope below those of E's second differences, which follow from it."""

EXPONENT_INTEGER = 9
"""Bits before the point of −E at a tile's centre."""

GRADIENT_INTEGER = 7
"""Bits before the point of E's slope at a tile's centre: at most 53 where the tile is reached."""

CURVATURE_INTEGER = 3
"""Bits before the point of E's second differences."""

POWER_SHIFTS = 8
"""Halvings within the reach of alpha: 1/255 > 2^−8."""

HALVING_BITS = (POWER_SHIFTS - 1).bit_length()
"""Width of their number."""


def mixed_shift(config: Config) -> int:
    """Shift to the right of the product of a factor and a slope."""
    return SLOPE.fraction + FACTOR_FRACTION - config.exponent_fraction - MIXED_GUARD


def lean_unit(config: Config) -> int:
    """Shift of shear·dy to the right to a length, for a shear of exponent 0."""
    return SHEAR.fraction + POSITION.fraction - config.exponent_fraction


def prepared_record(config: Config) -> Record:
    """A splat as setup takes it, the same for all tiles.

    u, v, scale: its centre. across, along: normalised factors; k and m. across_shift: k − scale,
    along_shift: m − scale. shear, lean_shift: significand, and by how much the product of it and dy
    is to be shifted to the right to be a length. slope: shear / 2^k. cxx, cxy, cyy: E's second
    differences.
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
    """E's coefficients; all but cxx and cyy are signed."""
    integers = {"e": EXPONENT_INTEGER, "gx": GRADIENT_INTEGER, "gy": GRADIENT_INTEGER}
    fraction = config.exponent_fraction
    plane = {name: Fixed(integer, fraction, signed=True) for name, integer in integers.items()}
    return Record("quadratic", plane | curvature_formats(config))


def tile_format(config: Config) -> Bits:
    """A tile's number in its group."""
    return Bits(max((config.group**2 - 1).bit_length(), 1))


SUM_INTEGER = COLOUR_INTEGER + 1
"""Bits of a pixel's colour before the point: rounding up adds less than 2^(weight − sum_fraction)
to what is a mean of colours."""

GROUP_BITS = 6
"""Bits of a group's number by which parts of stage 3 know whether they are at the same group: more
than there can be ends of groups on their way between them."""

COLOURS = CHANNELS


def colours(config: Config) -> dict[str, Fixed]:
    """A splat's colour."""
    return dict.fromkeys(COLOURS, colour_format(config))


def featured_record(config: Config) -> Record:
    """The input of stage 3: a splat and the tiles of the group that it reaches; or (end 1) the end
    of the group.
    """
    mask = Bits(config.group**2)
    return Record("featured", {"splat": feature_record(config), "mask": mask, "end": Bits(1)})


def readied_record(config: Config) -> Record:
    """The same, prepared."""
    mask = Bits(config.group**2)
    return Record("readied", {"splat": prepared_record(config), "mask": mask, "end": Bits(1)})


def position_record(config: Config) -> Record:
    """A group's position in the image, in groups."""
    return Record("position", _place(config, TILE * config.group))


def _place(config: Config, side: int) -> dict[str, Bits]:
    """Column and row in the image of a square with sides of so many pixels."""
    bits = Bits(max(((config.side_max - 1) // side).bit_length(), 1))
    return {"column": bits, "row": bits}


def background_code(config: Config, colour):
    """8 bits of a pixel of which a colour's code is all there is; of integers or hardware values.

    As stage 3 does it: the weight of a whole T, rounded to a pixel's colour, then to 8 bits.
    """
    product = config.weight + config.colour_fraction - config.sum_fraction
    coarser = config.sum_fraction - 8
    total = ((colour << config.weight) - colour + (1 << product - 1)) >> product
    return (total + (1 << coarser - 1)) >> coarser


def pair_record(config: Config) -> Record:
    """A splat and one of its tiles: the tile's place in the image, in tiles, and in the group."""
    tile = {"tile": tile_format(config), "end": Bits(1)}
    return Record("pair", {"splat": prepared_record(config)} | _place(config, TILE) | tile)


def around_record(config: Config) -> Record:
    """E around a tile. far: it is too far away."""
    fields = {"quadratic": quadratic_record(config), "far": Bits(1), "tile": tile_format(config)}
    return Record("around", fields | colours(config) | {"end": Bits(1)})


def marked_record(config: Config, blocks: Format) -> Record:
    """A pair with the blocks that it may reach: those that one rasterizer owns, or those of the
    tile by their level (`mark_min`)."""
    fields = {"quadratic": quadratic_record(config), "tile": tile_format(config)}
    fields |= {"blocks": blocks}
    return Record("marked", fields | colours(config) | {"end": Bits(1)})


def pixels_record(config: Config) -> Record:
    """A finished block: its pixels row by row."""
    return Record("pixels", {"pixels": Array(Array(Bits(8), 3), BLOCK**2)})


def exponent_min(fraction: int) -> int:
    """E from which on alpha is at least 1/255, in units of 2^−fraction."""
    return int(np.ceil(np.log2(ALPHA_MIN) * 2.0**fraction))


def mark_roundings(config: Config) -> int:
    """What the roundings of a pixel's E can raise it, in units of 2^−exponent_fraction."""
    most = max(STEPS)
    roundings = 2 * most + 3 * most**2  # of its slopes and its second differences
    finer = config.exponent_fraction - config.pixel_fraction
    return roundings << max(finer, 0)


def mark_min(config: Config) -> tuple[int, ...]:
    """E from which on a block is marked, in units of 2^−exponent_fraction, by its level: one is 0
    as long as a pixel of it has T ≥ 2^−a (`Config.faint`), k from T < 2^−(a + k − 1) on.

    With T < 2^−t a splat takes less than 2^−b where alpha < 2^−(b − t). Alpha 1/255 is taken for
    2^−8, so that all differ by whole numbers.
    """
    least = [-POWER_SHIFTS]
    if config.faint:
        from_, below, ends = config.faint
        least += [max(t - below, -POWER_SHIFTS) for t in range(from_, ends)]
    fraction = config.exponent_fraction
    return tuple((e << fraction) - mark_roundings(config) for e in least)


@cache
def power_table(config: Config) -> tuple[int, ...]:
    """2^x in units of 2^−power_mantissa for x from −1 to 0, each for the middle of its step; about
    the largest alpha at most. All are less than 1, and none less than 1/2.
    """
    steps = 1 << config.power_fraction
    values = 2.0 ** ((np.arange(steps) + 0.5) / steps - 1)
    values = np.rint(np.minimum(values, ALPHA_MAX) * 2.0**config.power_mantissa)
    return tuple(min(int(value), (1 << config.power_mantissa) - 1) for value in values)


def transmittance_min(config: Config) -> int:
    """T below which a pixel ends, or all of T is taken; none is below 0."""
    if not config.early_termination:
        return 0
    if config.faint:
        return 1 << config.transmittance - config.faint[2]
    return int(np.ceil(TRANSMITTANCE_MIN * 2.0**config.transmittance))


def faint_rule(config: Config) -> tuple[float, float, float] | None:
    """The rule for what is too faint as `spec.convention.Convention` has it: 2^−a, 2^−b, 2^−c."""
    if not config.faint:
        return None
    from_, below, ends = (2.0**-places for places in config.faint)
    return from_, below, ends


def owner(config: Config, block: int) -> tuple[int, int]:
    """Rasterizer of a tile's block, and the block's number there. Neighbours go to different ones,
    so that a small splat keeps several of them busy.
    """
    row, column = divmod(block, BLOCKS)
    columns = span_blocks(config)
    rows = config.rasterizers // columns
    number = row // rows * (BLOCKS // columns) + column // columns
    return (column + row) % columns + columns * (row % rows), number


def block_count(config: Config) -> int:
    """Blocks of a group that a rasterizer owns."""
    return config.group**2 * BLOCKS**2 // config.rasterizers


def owned(config: Config, rasterizer: int) -> list[int]:
    """A rasterizer's blocks of a tile, in the order of their numbers there."""
    pairs = [(owner(config, block), block) for block in range(BLOCKS**2)]
    return [block for (who, _), block in sorted(pairs) if who == rasterizer]


def span_blocks(config: Config) -> int:
    """Blocks side by side that are written together, one of each rasterizer: a span."""
    return min(config.rasterizers, BLOCKS)


def spans_meet(config: Config) -> bool:
    """Whether two spans side by side fill beats of the port of which they share one: then they are
    written one after the other, and what the first has of that beat waits for the second."""
    size, beat = span_blocks(config) * BLOCK * PIXEL, port_bytes(config)
    several = config.group * BLOCKS > span_blocks(config)
    return several and size > beat and size % beat != 0 and 2 * size % beat == 0


def tiles_meet(config: Config) -> bool:
    """Whether two such spans are rows of two tiles' blocks."""
    return spans_meet(config) and span_blocks(config) == BLOCKS


def nth_block(config: Config, number: int):
    """Which of a rasterizer's blocks of a group, tile after tile, is given out as the one of that
    number; of integers or hardware values. Rows of blocks of two tiles side by side follow each
    other where they share beats of the port (`tiles_meet`).
    """
    if not tiles_meet(config):
        return number
    own = BLOCKS**2 // config.rasterizers
    bits = own.bit_length() - 1
    second, block, tiles = number & 1, number >> 1 & own - 1, number >> 1 + bits
    return block | second << bits | tiles << bits + 1
