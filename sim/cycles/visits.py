"""Blocks that marking cannot leave out, of lanes in quads: what each visit does to a quad's level.

A visit depends on the order of splats alone, not on cycles, so that it is found beforehand.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from splatcore.golden.blend import PIXEL, around_block, blend_pixel, constants, twice_highest
from splatcore.golden.pipeline import Frame
from splatcore.golden.setup import Quadratic, prepare, quadratic
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.quads import QUADS, ended_level
from splatcore.spec.raster import BLOCKS, POWER_SHIFTS, STEPS

BLOCKS_A_TILE = BLOCKS**2
QUAD_BITS = 4  # bits of a visit's number for each quad
NOT_SEEN = POWER_SHIFTS
"""Halvings of a quad in which no pixel has alpha ≥ 1/255."""

UNSEEN = sum(NOT_SEEN << QUAD_BITS * quad for quad in range(QUADS))
"""A visit's halvings if no quad is seen."""

MARK_BITS = 3  # bits of a pair's number for each block
LATE = 200  # entries behind a group's last live pixel that hardware may still take


class Visits(NamedTuple):
    """The pairs of a frame's entries and tiles, and their visits by block."""

    marks: np.ndarray  # [pairs] int64, `MARK_BITS` per block: levels at which it is marked
    first: np.ndarray  # [pairs + 1] a pair's first visit
    halvings: np.ndarray  # [visits] uint16, `QUAD_BITS` per quad: least of its seen pixels
    levels: np.ndarray  # [visits] uint16, `QUAD_BITS` per quad: its level after the visit


def visits(config: Config, frame: Frame) -> Visits:
    """Return the visits of a frame, also of blocks whose pixels have ended."""
    entries, (height, width) = frame.sorted, frame.pixels.shape[:2]
    pairs = int(np.bitwise_count(entries.mask.astype(np.uint64)).sum())
    found = Visits(
        np.zeros(pairs, np.int64), np.zeros(pairs + 1, np.int64),
        *np.empty((2, pairs * BLOCKS_A_TILE), np.uint16),
    )  # fmt: skip
    columns, side = group_grid(config, width, height)[1], group_pixels(config)
    machine = constants(config, (0, 0, 0), mark_all=False, rounded=True, rgba=False)
    splats, pixels = prepare(config, frame.binned.features), np.zeros((side, side), PIXEL)
    places = entries.start.astype(np.int64), entries.splat, entries.mask.astype(np.int64)
    count = _trace(
        *places, splats, columns, (width, height), machine, ended_level(config), pixels, found
    )
    return found._replace(halvings=found.halvings[:count], levels=found.levels[:count])


@njit(cache=True)
def _trace(start, splat, mask, splats, columns, size, machine, ended, pixels, found):
    """Fill `found`; return the number of visits."""
    count = pair = 0
    for group in range(len(start) - 1):
        row, column = group // columns * machine.group, group % columns * machine.group
        live = _begin(pixels, size[0] - column * TILE, size[1] - row * TILE, machine.full)
        late = 0
        for k in range(start[group], start[group + 1]):
            late += live == 0
            for tile in range(machine.group**2):
                if not mask[k] >> tile & 1:
                    continue
                found.first[pair], pair = count, pair + 1
                if late > LATE:
                    continue
                y, x = tile // machine.group, tile % machine.group
                own = splats[splat[k]]
                around, near = quadratic(own, column + x, row + y, machine.fraction)
                if near:
                    part = pixels[y * TILE : (y + 1) * TILE, x * TILE : (x + 1) * TILE]
                    marks, count, gone = _tile(around, part, machine, ended, count, found)
                    found.marks[pair - 1], live = marks, live - gone
    found.first[pair] = count
    return count


@njit(cache=True)
def _begin(pixels, wide, high, full):
    """Begin a group; return the number of its pixels in the image."""
    live = 0
    for y in range(len(pixels)):
        for x in range(len(pixels)):
            pixels[y, x].rest, pixels[y, x].live = full, y < high and x < wide
            live += pixels[y, x].live
    return live


@njit(cache=True)
def _tile(around, pixels, machine, ended, count, found):
    """Visit a tile's marked blocks; return the marks, the number of visits and of ended pixels."""
    marks = gone = 0
    for block in range(BLOCKS_A_TILE):
        row, column = block // BLOCKS, block % BLOCKS
        own = around_block(around, STEPS[column], STEPS[row])
        highest, levels = twice_highest(own), 0
        while levels < len(machine.levels) and highest >= machine.levels[levels].marked:
            levels += 1
        if not levels:
            continue
        marks |= levels << MARK_BITS * block
        coarser = machine.coarser
        steps = Quadratic(
            4 * own.e >> coarser, 2 * own.gx >> coarser, 2 * own.gy >> coarser,
            own.cxx >> coarser, own.cxy >> coarser, own.cyy >> coarser,
        )  # fmt: skip
        y, x = row * BLOCK, column * BLOCK
        part = pixels[y : y + BLOCK, x : x + BLOCK]
        halvings, reached, ends = _block(steps, part, machine, ended)
        found.halvings[count], found.levels[count] = halvings, reached
        count, gone = count + 1, gone + ends
    return marks, count, gone


@njit(cache=True)
def _block(around, pixels, machine, ended):
    """Blend a splat into a block; return a visit's two numbers, and the number of ended pixels."""
    halvings = reached = gone = 0
    for quad in range(QUADS):
        least, lowest = NOT_SEEN, ended
        for k in range(BLOCK**2 // QUADS):
            j, i = quad // 2 * 2 + k // 2, quad % 2 * 2 + k % 2
            a, b, pixel = STEPS[i], STEPS[j], pixels[j, i]
            exponent = around.e + around.gx * a + around.gy * b
            exponent += around.cxy * a * b - around.cxx * a * a - around.cyy * b * b
            if exponent >= machine.lowest:
                exponent = min(exponent, -1)
                least = min(least, -1 - (exponent >> machine.finer + machine.steps))
                if pixel.live:
                    blend_pixel(pixel, exponent, (0, 0, 0), machine)
                    gone += not pixel.live
            lowest = min(lowest, _level(pixel, machine, ended))
        halvings |= least << QUAD_BITS * quad
        reached |= lowest << QUAD_BITS * quad
    return halvings, reached, gone


@njit(cache=True)
def _level(pixel, machine, ended):
    """Return a pixel's level."""
    level = 0 if pixel.live else ended
    while level < ended and pixel.rest < machine.levels[level].above:
        level += 1
    return level
