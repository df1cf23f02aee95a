"""The reference renderer's inner loops: the tiles that a splat touches, and blending a tile.

Compiled by numba, parallel over tiles. One thread computes a tile in a fixed order, so the result
does not depend on the number of threads.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from splatcore.spec.convention import BLOCK, TILE

SLACK = 1e-9
"""Relative widening of a box or a reach before the exact comparison decides."""


@dataclass(frozen=True, eq=False)
class TileLists:
    """Depth-ordered splat lists of all tiles, row by row, one after the other."""

    start: np.ndarray  # [tiles + 1] first pair of each tile in `splat`
    splat: np.ndarray  # [pairs] indices into the splats, front to back


def bin_splats(centre, conic, reach, boxes, width, height, exact) -> TileLists:
    """Return lists of the tiles in `boxes` [M, 4]; if `exact`, only of tiles really reached."""
    columns, rows = -(-width // TILE), -(-height // TILE)
    lengths = np.zeros(columns * rows, np.int64)
    _visit_tiles(centre, conic, reach, boxes, columns, width, height, exact, lengths, lengths[:0])
    start = np.concatenate([[0], np.cumsum(lengths)])
    splat = np.empty(start[-1], np.int32)
    _visit_tiles(
        centre, conic, reach, boxes, columns, width, height, exact, start[:-1].copy(), splat
    )
    return TileLists(start, splat)


@njit(cache=True)
def _visit_tiles(centre, conic, reach, boxes, columns, width, height, exact, slot, splat):
    """Count pairs per tile in `slot` (if `splat` is empty), else write them from `slot` on."""
    for m in range(len(boxes)):
        for row in range(boxes[m, 2], boxes[m, 3] + 1):
            y0 = row * TILE - centre[m, 1]
            y1 = min(row * TILE + TILE, height) - 1 - centre[m, 1]
            for column in range(boxes[m, 0], boxes[m, 1] + 1):
                x0 = column * TILE - centre[m, 0]
                x1 = min(column * TILE + TILE, width) - 1 - centre[m, 0]
                if exact and smallest_q(conic[m], x0, x1, y0, y1) > reach[m]:
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


def rasterize(lists, splats, width, height, convention, progress=None):
    """Blend all tiles.

    Returns image [H, W, 3], transmittance [H, W] and the counts of work [4]: pairs met before all
    pixels of their tile had ended; 4×4 blocks in which a live pixel had alpha ≥ alpha_min;
    contributions; pixels that ended.
    """
    columns, rows = -(-width // TILE), -(-height // TILE)
    image, transmittance = np.zeros((height, width, 3)), np.ones((height, width))
    work = np.zeros((columns * rows, 4), np.int64)
    from_, below, ends = convention.faint or (0.0, 0.0, convention.transmittance_min)
    limits = np.array([convention.alpha_min, convention.alpha_max, from_, below, ends])
    takes_all = convention.faint is not None
    for row in range(rows):
        _blend_tile_row(
            row, columns, lists.start, lists.splat, splats.centre,
            splats.conic, splats.opacity, splats.reach, splats.extent, splats.colour, limits,
            takes_all, image, transmittance, work,
        )  # fmt: skip
        if progress:
            progress((row + 1) * columns, rows * columns)
    return image, transmittance, work.sum(0)


@njit(cache=True)
def pixels(low, high, first, end):
    """Return the integers of first … end − 1 within [low, high], any finite or infinite floats."""
    return range(int(max(np.ceil(low), first)), int(min(np.floor(high), end - 1)) + 1)


@njit(parallel=True, cache=True)
def _blend_tile_row(
    row, columns, start, splat, centre, conic, opacity, reach, extent, colour, limits,
    takes_all, image, transmittance, work,
):  # fmt: skip
    alpha_min, alpha_max, from_, below, ends = limits
    height, width = transmittance.shape
    for column in prange(columns):
        tile = row * columns + column
        left, top = column * TILE, row * TILE
        right, bottom = min(left + TILE, width), min(top + TILE, height)
        live = np.ones((TILE, TILE), np.bool_)
        alive = (right - left) * (bottom - top)
        for pair in range(start[tile], start[tile + 1]):
            if alive == 0:
                break
            work[tile, 0] += 1
            m = splat[pair]
            u, v = centre[m]
            a, b, c = conic[m]
            red, green, blue = colour[m]
            wide, high = extent[m] * (1 + SLACK) + SLACK
            limit = reach[m] * (1 + SLACK) + SLACK
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
                    alpha = min(alpha_max, opacity[m] * np.exp(-0.5 * q))
                    if alpha < alpha_min:
                        continue
                    t = transmittance[y, x]
                    if t < from_ and t * alpha < below:
                        continue
                    blocks |= 1 << ((y - top) // BLOCK * (TILE // BLOCK) + (x - left) // BLOCK)
                    rest = t * (1 - alpha)
                    if rest < ends:
                        live[y - top, x - left] = False
                        alive -= 1
                        work[tile, 3] += 1
                        if not takes_all:
                            continue
                        rest = 0.0
                    weight = t * alpha if rest else t
                    image[y, x, 0] += weight * red
                    image[y, x, 1] += weight * green
                    image[y, x, 2] += weight * blue
                    transmittance[y, x] = rest
                    work[tile, 2] += 1
            while blocks:
                blocks &= blocks - 1
                work[tile, 1] += 1
