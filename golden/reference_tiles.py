"""The reference renderer's inner loops: the tiles that a splat touches, and blending a tile.

Compiled by numba, parallel over tiles. One thread computes a tile in a fixed order, so the result
does not depend on the number of threads.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from splatcore.spec.convention import BLOCK, TILE, Convention, Faint
from splatcore.spec.progress import report

SLACK = 1e-9
"""Relative widening of a box or a reach before the exact comparison decides."""


WORK = np.dtype([(name, np.int64) for name in ("pairs", "blocks", "contributions", "ended")])
"""Counts of blending.

pairs: pairs met before all pixels of their tile had ended
blocks: 4×4 blocks in which a live pixel had alpha ≥ alpha_min, by pair
contributions: blended pixels, by pair
ended: pixels that ended
"""


class TileLists(NamedTuple):
    """Depth-ordered splat lists of all tiles, row by row, one after the other."""

    start: np.ndarray  # [tiles + 1] first pair of each tile in `splat`
    splat: np.ndarray  # [pairs] indices into the splats, front to back


class Outlines(NamedTuple):
    """The arrays of `golden.reference.Splats` that binning reads."""

    centre: np.ndarray
    conic: np.ndarray
    reach: np.ndarray


class Ellipses(NamedTuple):
    """The arrays of `golden.reference.Splats` that blending reads."""

    centre: np.ndarray
    conic: np.ndarray
    opacity: np.ndarray
    reach: np.ndarray
    extent: np.ndarray
    colour: np.ndarray


class Limits(NamedTuple):
    """A convention's thresholds. takes_all: a pixel's last splat takes all of T."""

    alpha_min: float
    alpha_max: float
    dark: float  # as in `Faint`; 0 without a rule
    taken: float
    ends: float
    takes_all: bool


def bin_splats(splats, boxes, width: int, height: int, exact: bool) -> TileLists:
    """Return lists of the tiles in `boxes` [M, 4]; if `exact`, only of tiles really reached."""
    about = Outlines(splats.centre, splats.conic, splats.reach), boxes, width, height, exact
    lengths = np.zeros(-(-width // TILE) * -(-height // TILE), np.int64)
    _visit_tiles(*about, lengths, np.empty(0, np.int32))
    start = np.concatenate([[0], np.cumsum(lengths)])
    splat = np.empty(start[-1], np.int32)
    _visit_tiles(*about, start[:-1].copy(), splat)
    return TileLists(start, splat)


@njit(cache=True)
def _visit_tiles(splats, boxes, width, height, exact, slot, splat):
    """Count pairs per tile in `slot` (if `splat` is empty), else write them from `slot` on."""
    columns = -(-width // TILE)
    for m in range(len(boxes)):
        u, v = splats.centre[m]
        for row in range(boxes[m, 2], boxes[m, 3] + 1):
            y0 = row * TILE - v
            y1 = min(row * TILE + TILE, height) - 1 - v
            for column in range(boxes[m, 0], boxes[m, 1] + 1):
                x0 = column * TILE - u
                x1 = min(column * TILE + TILE, width) - 1 - u
                if exact and smallest_q(splats.conic[m], x0, x1, y0, y1) > splats.reach[m]:
                    continue
                tile = row * columns + column
                if len(splat):
                    splat[slot[tile]] = m
                slot[tile] += 1


@njit(cache=True)
def smallest_q(conic, x0, x1, y0, y1):
    """Return the minimum of A·x² + 2·B·x·y + C·y² over the rectangle [x0, x1] × [y0, y1].

    The form is convex with its minimum 0 at the origin. Outside of it, the minimum is on an edge
    that faces the origin.
    """
    if x0 <= 0 <= x1 and y0 <= 0 <= y1:
        return 0.0
    a, b, c = conic
    best = np.inf
    for x in (x0, x1):
        y = min(max(-b * x / c, y0), y1) if c > 0 else y0  # 0 if the determinant overflows
        best = min(best, a * x * x + 2 * b * x * y + c * y * y)
    for y in (y0, y1):
        x = min(max(-b * y / a, x0), x1) if a > 0 else x0
        best = min(best, a * x * x + 2 * b * x * y + c * y * y)
    return best


def count_rows(centre, extent, width, height) -> int:
    """Return the sum of tile rows in the splats' boxes, the steps of a row-interval test."""
    low = np.clip(np.ceil(centre[:, 1] - extent[:, 1]), 0, height) // TILE
    high = np.clip(np.floor(centre[:, 1] + extent[:, 1]), -1, height - 1) // TILE
    return int(np.maximum(high - low + 1, 0).sum())


class Blended(NamedTuple):
    """The result of blending all tiles."""

    image: np.ndarray  # [H, W, 3]
    transmittance: np.ndarray  # [H, W]
    work: np.ndarray  # [tiles] of `WORK`


def rasterize(
    lists: TileLists, splats, width: int, height: int, convention: Convention, progress=None
) -> Blended:
    """Blend all tiles."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    work = np.zeros(columns * rows, WORK)
    found = Blended(np.zeros((height, width, 3)), np.ones((height, width)), work)
    rule = convention.faint or Faint(0.0, 0.0, convention.transmittance_min)
    takes_all = convention.faint is not None
    limits = Limits(convention.alpha_min, convention.alpha_max, *rule, takes_all)
    ellipses = Ellipses(*(getattr(splats, name) for name in Ellipses._fields))
    progress = progress or partial(report, "tiles")
    for row in range(rows):
        _blend_tile_row(row, columns, lists, ellipses, limits, found)
        progress((row + 1) * columns, rows * columns)
    return found


@njit(cache=True)
def pixels(low, high, first, end):
    """Return the integers of first … end − 1 within [low, high], any finite or infinite floats."""
    return range(int(max(np.ceil(low), first)), int(min(np.floor(high), end - 1)) + 1)


@njit(parallel=True, cache=True)
def _blend_tile_row(row, columns, lists, splats, limits, found):
    for column in prange(columns):
        _blend_tile(row * columns + column, row * TILE, column * TILE, lists, splats, limits, found)


@njit(cache=True)
def _blend_tile(tile, top, left, lists, splats, limits, found):
    """Blend a tile's splats into the image, from (left, top) on."""
    image, transmittance, work = found.image, found.transmittance, found.work[tile]
    height, width = transmittance.shape
    right, bottom = min(left + TILE, width), min(top + TILE, height)
    live = np.ones((TILE, TILE), np.bool_)
    alive = (right - left) * (bottom - top)
    for pair in range(lists.start[tile], lists.start[tile + 1]):
        if alive == 0:
            break
        work.pairs += 1
        m = lists.splat[pair]
        u, v = splats.centre[m]
        a, b, c = splats.conic[m]
        red, green, blue = splats.colour[m]
        wide, high = splats.extent[m] * (1 + SLACK) + SLACK
        limit = splats.reach[m] * (1 + SLACK) + SLACK
        blocks = 0
        for y in pixels(v - high, v + high, top, bottom):
            dy = y - v
            for x in pixels(u - wide, u + wide, left, right):
                if not live[y - top, x - left]:
                    continue
                dx = x - u
                q = a * dx * dx + 2 * b * dx * dy + c * dy * dy
                if q > limit:
                    continue
                alpha = min(limits.alpha_max, splats.opacity[m] * np.exp(-0.5 * q))
                if alpha < limits.alpha_min:
                    continue
                t = transmittance[y, x]
                if t < limits.dark and t * alpha < limits.taken:
                    continue
                blocks |= 1 << ((y - top) // BLOCK * (TILE // BLOCK) + (x - left) // BLOCK)
                rest = t * (1 - alpha)
                if rest < limits.ends:
                    live[y - top, x - left] = False
                    alive -= 1
                    work.ended += 1
                    if not limits.takes_all:
                        continue
                    rest = 0.0
                weight = t * alpha if rest else t
                image[y, x, 0] += weight * red
                image[y, x, 1] += weight * green
                image[y, x, 2] += weight * blue
                transmittance[y, x] = rest
                work.contributions += 1
        while blocks:
            blocks &= blocks - 1
            work.blocks += 1
