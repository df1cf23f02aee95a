"""Blending of a group's splats, compiled: the loops of `golden.raster`."""

from typing import NamedTuple

import numpy as np
from numba import njit

from splatcore.golden.setup import Quadratic, quadratic
from splatcore.spec import raster as stage_3
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE, Faint
from splatcore.spec.raster import BLOCKS, STEPS, owner

LEVEL = np.dtype([("above", np.int64), ("marked", np.int64)])
"""A level of blocks (`spec.raster.mark_min`).

above: T from which on a block's level is lower
marked: twice the E from which on a block is marked
"""

PIXEL = np.dtype([("rest", np.int64), ("sum", np.int64, len(CHANNELS)), ("live", np.int64)])
"""A pixel while its group is blended: T, its colour so far, and 1 until it ends."""

FAINT, ENDED, BLENDED = range(3)
"""Outcome of blending a splat into a pixel."""


class Machine(NamedTuple):
    """A machine's constants. T and sums are integers; `finer` … `visible` are right shifts."""

    group: int  # tiles per side of a group
    owners: np.ndarray  # [blocks of a tile] their rasterizers
    fraction: int  # fraction bits of E around a tile
    levels: np.ndarray  # of `LEVEL`
    coarser: int  # from E in half-pixel steps to a pixel's E
    lowest: int  # lowest E of a pixel with alpha ≥ 1/255
    finer: int  # from a pixel's E to an index of the table
    steps: int  # log2 of the table's length
    mantissa: int  # fraction bits of the table
    table: np.ndarray  # powers of two
    full: int  # T of a new pixel
    rest_min: int  # T below which a pixel ends
    dark: int  # threshold of the faintness rule; 0 without it
    taken: int  # likewise
    takes_all: bool  # a pixel's last splat takes all of T
    narrower: int  # from T to a weight
    product: int  # from a weight times a colour to a sum
    dropped: int  # from a sum to the result
    visible: int  # from a sum to 8 bits
    background: np.ndarray  # [3] codes
    rgba: bool  # a pixel has alpha, and no background


class Tile(NamedTuple):
    """State of a tile: `PIXEL` [16, 16]; live pixels, and the level, of each block [4, 4]."""

    pixels: np.ndarray
    live: np.ndarray
    level: np.ndarray


def constants(config: Config, background, mark_all: bool, rounded: bool, rgba: bool) -> Machine:
    """Return the constants of a machine; `mark_all`: with one level, at which E marks all."""
    pixel, bits = config.pixel_fraction, config.transmittance
    rule = config.faint or Faint(bits + 1, bits, bits)
    least = 2 * np.array(stage_3.mark_min(config))
    if mark_all:
        least = np.full(1, -(1 << 62))
    levels = np.zeros(len(least), LEVEL)
    levels["marked"] = least
    levels["above"][:-1] = [1 << bits - rule.dark - k for k in range(len(least) - 1)]
    return Machine(
        group=config.group,
        owners=np.array([owner(config, block) for block in range(BLOCKS**2)]),
        fraction=config.exponent_fraction,
        levels=levels,
        coarser=config.exponent_fraction + 2 - pixel,
        lowest=stage_3.exponent_min(pixel),
        finer=pixel - config.power_fraction,
        steps=config.power_fraction,
        mantissa=config.power_mantissa,
        table=np.array(stage_3.power_table(config)),
        full=(1 << bits) - 1,
        rest_min=stage_3.transmittance_min(config),
        dark=1 << bits >> rule.dark,
        taken=1 << bits - rule.taken,
        takes_all=bool(config.faint),
        narrower=bits - config.weight,
        product=config.weight + config.colour_fraction - config.sum_fraction,
        dropped=config.sum_fraction - 8 if rounded else 0,
        visible=config.sum_fraction - 8,
        background=np.array((0, 0, 0) if rgba else background),
        rgba=rgba,
    )


@njit(cache=True)
def blend_group(group, splats, entries, first, columns, machine, frame):
    """Rasterize a group into `frame`, a `golden.raster.Raster`."""
    tiles, counts = machine.group, frame.pairs[group]
    side = tiles * TILE
    row, column = group // columns * tiles, group % columns * tiles
    top, left = row * TILE, column * TILE
    high = min(side, frame.pixels.shape[0] - top)
    wide = min(side, frame.pixels.shape[1] - left)
    pixels = np.zeros((side, side), PIXEL)
    live = np.zeros((side // BLOCK, side // BLOCK), np.int64)
    level = np.zeros_like(live)
    for y in range(side):
        for x in range(side):
            pixels[y, x].rest = machine.full
            pixels[y, x].live = y < high and x < wide
            live[y // BLOCK, x // BLOCK] += pixels[y, x].live
    remaining = live.sum()
    for k in range(entries.start[group], entries.start[group + 1]):
        if remaining == 0:
            break
        counts.entries += 1
        splat, pair = splats[entries.splat[k]], first[k] - 1
        for number in range(tiles * tiles):
            if not entries.mask[k] >> number & 1:
                continue
            pair += 1
            y, x = number // tiles * BLOCKS, number % tiles * BLOCKS
            tile = Tile(
                pixels[y * BLOCK : y * BLOCK + TILE, x * BLOCK : x * BLOCK + TILE],
                live[y : y + BLOCKS, x : x + BLOCKS], level[y : y + BLOCKS, x : x + BLOCKS],
            )  # fmt: skip
            if tile.live.sum() == 0:
                continue
            frame.blocks[pair] = 0
            counts.pairs += 1
            place = column + number % tiles, row + number // tiles
            around, near = quadratic(splat, place[0], place[1], machine.fraction)
            if not near:
                counts.far += 1
                continue
            frame.blocks[pair], ended = _blend_tile(around, splat, tile, machine, frame.work[group])
            counts.empty += frame.blocks[pair] == 0
            remaining -= ended
    for y in range(high):
        for x in range(wide):
            _finish(pixels[y, x], machine, frame.pixels[top + y, left + x])


@njit(cache=True)
def around_block(around, p, q):
    """Return E around (2p, 2q) from a tile's centre, the centre of a block."""
    e, gx, gy, cxx, cxy, cyy = around
    centre = e + 2 * (gx * p + gy * q) - 4 * (cxx * p * p - cxy * p * q + cyy * q * q)
    slope_x, slope_y = gx - 4 * cxx * p + 2 * cxy * q, gy - 4 * cyy * q + 2 * cxy * p
    return Quadratic(centre, slope_x, slope_y, cxx, cxy, cyy)


@njit(cache=True)
def twice_highest(around):
    """Return a bound on twice the E of a block's pixels: E is concave, below its tangent plane."""
    return 2 * around.e + 3 * (abs(around.gx) + abs(around.gy))


@njit(cache=True)
def _blend_tile(around, splat, tile, machine, work):
    """Blend a splat into a tile.

    Returns the marked and visited blocks, and the number of pixels that ended.
    """
    coarser = machine.coarser
    blocks = ended = 0
    for row in range(BLOCKS):
        for column in range(BLOCKS):
            if not tile.live[row, column]:
                continue
            own = around_block(around, STEPS[column], STEPS[row])
            if twice_highest(own) < machine.levels[tile.level[row, column]].marked:
                continue
            number = row * BLOCKS + column
            blocks |= 1 << number
            steps = Quadratic(
                4 * own.e >> coarser, 2 * own.gx >> coarser, 2 * own.gy >> coarser,
                own.cxx >> coarser, own.cxy >> coarser, own.cyy >> coarser,
            )  # fmt: skip
            visited, gone, most = _blend_block(
                steps, (splat.red, splat.green, splat.blue),
                tile.pixels[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK],
                machine, work[machine.owners[number]],
            )  # fmt: skip
            while most < machine.levels[tile.level[row, column]].above:
                tile.level[row, column] += 1
            blocks |= visited << 16 + number
            tile.live[row, column] -= gone
            ended += gone
    return blocks, ended


@njit(cache=True)
def _blend_block(around, colour, pixels, machine, work):
    """Blend a splat into a block's pixels [4, 4].

    around: E in half-pixel steps from the block's centre
    Returns 1 if a pixel has alpha ≥ 1/255, the number of pixels that ended, and the largest T of
    the live pixels.
    """
    visited = contributing = False
    ended = most = 0
    for j in range(BLOCK):
        for i in range(BLOCK):
            a, b, pixel = STEPS[i], STEPS[j], pixels[j, i]
            exponent = around.e + around.gx * a + around.gy * b
            exponent += around.cxy * a * b - around.cxx * a * a - around.cyy * b * b
            if exponent >= machine.lowest:
                visited = True
                if pixel.live:
                    did = blend_pixel(pixel, min(exponent, -1), colour, machine)
                    contributing |= did != FAINT
                    work.contributions += did == BLENDED
                    ended += not pixel.live
            if pixel.live:
                most = max(most, pixel.rest)
    work.marked += 1
    work.visited += visited
    work.contributing += contributing
    work.ended += ended
    return int(visited), ended, most


@njit(cache=True)
def blend_pixel(pixel, exponent, colour, machine):
    """Blend a splat with log2(alpha) < 0 into a pixel, or end it; return the outcome."""
    exponent >>= machine.finer
    halvings = -1 - (exponent >> machine.steps)
    power = machine.table[exponent & ((1 << machine.steps) - 1)]
    taken = pixel.rest * power >> machine.mantissa + halvings
    if pixel.rest < machine.dark and taken < machine.taken:
        return FAINT
    rest = pixel.rest - taken
    if rest < machine.rest_min:
        pixel.live = 0
        if not machine.takes_all:
            return ENDED
        rest = 0
    weight = (pixel.rest >> machine.narrower) - (rest >> machine.narrower)
    pixel.rest = rest
    for k in range(3):
        pixel.sum[k] += weight * colour[k] + (1 << machine.product - 1) >> machine.product
    return BLENDED


@njit(cache=True)
def _finish(pixel, machine, out):
    """Write a pixel's colour over the background, at most 255, rounded to nearest; and alpha."""
    weight, product, dropped = pixel.rest >> machine.narrower, machine.product, machine.dropped
    most = 255 << machine.visible - dropped
    for k in range(3):
        behind = weight * machine.background[k] + (1 << product - 1) >> product
        out[k] = min(pixel.sum[k] + behind + (1 << dropped >> 1) >> dropped, most)
    if machine.rgba:
        unit = machine.full + 1
        out[3] = (255 * (machine.full - pixel.rest) + unit // 2) // unit
