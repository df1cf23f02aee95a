"""Tile lists, blending, and the gradients of blending for optimisation, compiled by numba.

A tile is blended row by row, with the sixteen pixels of a row in one vector. Pairs of splat and
tile are numbered splat by splat. Each pair's gradients are written separately, then summed per
splat in a fixed order, so the result does not depend on the number of threads.
"""

import numba
import numpy as np
from numba import njit, prange

from splatcore.model.gradients.rendering_points import (
    BLUE,
    GRADIENTS,
    GREEN,
    HIGH,
    OPACITY,
    REACH,
    RED,
    WIDE,
    A,
    B,
    C,
    U,
    V,
)
from splatcore.spec.convention import ALPHA_MIN, TILE

FAST = {"reassoc", "contract", "arcp", "nsz"}
"""Assumptions allowed to the compiler: sums may be reordered; NaN and Inf are preserved."""

REACH_MAX = 2 * np.log(1 / ALPHA_MIN) + 0.2
"""Quadratic forms are clamped to this, to keep the exponential in range; nothing beyond blends."""

MIDDLE = REACH_MAX / 64
TERMS = np.array([np.exp(-MIDDLE) / float(np.prod(np.arange(1.0, k + 1))) for k in range(8)])
"""Taylor terms of exp(MIDDLE − x) for x = q/32; to the 16th power it is exp(−q/2) within 4e-10."""

PATIENCE = 8  # splats between checks whether any pixel of the tile is still live


@njit(cache=True)
def smallest_form(a, b, c, x0, x1, y0, y1):
    """Minimum of A·x² + 2·B·x·y + C·y² over the rectangle [x0, x1] × [y0, y1]."""
    if x0 <= 0 <= x1 and y0 <= 0 <= y1:
        return 0.0 * a
    best = np.inf
    for x in (x0, x1):
        y = min(max(-b * x / c, y0), y1) if c > 0 else y0  # 0 if the determinant overflows
        best = min(best, a * x * x + 2 * b * x * y + c * y * y)
    for y in (y0, y1):
        x = min(max(-b * y / a, x0), x1) if a > 0 else x0
        best = min(best, a * x * x + 2 * b * x * y + c * y * y)
    return best


@njit(cache=True)
def _visit_tiles(splat, width, height, tiles):
    """Write the tiles that the splat reaches to `tiles`, as many as fit; return their number."""
    columns = (width + TILE - 1) // TILE
    u, v, wide, high = splat[U], splat[V], splat[WIDE], splat[HIGH]
    left = int(max(np.ceil(u - wide), 0.0)) // TILE  # below 2^63: `rendering_points.FARTHEST`
    right = int(min(np.floor(u + wide), width - 1.0)) // TILE
    top = int(max(np.ceil(v - high), 0.0)) // TILE
    bottom = int(min(np.floor(v + high), height - 1.0)) // TILE
    found = 0
    for row in range(top, bottom + 1):
        y0, y1 = row * TILE - v, min(row * TILE + TILE, height) - 1 - v
        for column in range(left, right + 1):
            x0, x1 = column * TILE - u, min(column * TILE + TILE, width) - 1 - u
            form = smallest_form(splat[A], splat[B], splat[C], x0, x1, y0, y1)
            if form <= splat[REACH] * 1.000001 + 1e-6:
                if found < len(tiles):
                    tiles[found] = row * columns + column
                found += 1
    return found


@njit(parallel=True, cache=True)
def _count(splats, width, height, counts):
    for m in prange(len(splats)):
        counts[m] = _visit_tiles(splats[m], width, height, np.empty(0, np.int32))


@njit(parallel=True, cache=True)
def _write(splats, width, height, first, tiles):
    for m in prange(len(splats)):
        _visit_tiles(splats[m], width, height, tiles[first[m] : first[m + 1]])


@njit(cache=True)
def _sort(first, tiles, start, pair, owner):
    """Compute the lists: pairs by tile, in the order of the splats."""
    slot = start[:-1].copy()
    for m in range(len(first) - 1):
        for p in range(first[m], first[m + 1]):
            tile = tiles[p]
            pair[slot[tile]], owner[slot[tile]] = p, m
            slot[tile] += 1


def tile_lists(splats: np.ndarray, width: int, height: int) -> tuple[np.ndarray, ...]:
    """Build the tile lists of splats [M, 12] in depth order. Returns
    - first [M + 1]: number of each splat's first pair,
    - start [tiles + 1]: first entry of each tile's list,
    - pair, owner [entries]: number of each entry's pair, and its splat.
    """
    tiles_in_all = -(-width // TILE) * -(-height // TILE)
    counts = np.empty(len(splats), np.int64)
    _count(splats, width, height, counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    tiles = np.empty(first[-1], np.int32)
    _write(splats, width, height, first, tiles)
    start = np.concatenate([[0], np.cumsum(np.bincount(tiles, minlength=tiles_in_all))])
    pair, owner = np.empty(first[-1], np.int64), np.empty(first[-1], np.int64)
    _sort(first, tiles, start, pair, owner)
    return first, start, pair, owner


def blend(splats, lists, width, height, limits) -> tuple[np.ndarray, ...]:
    """Blend splats [M, 12], in their own floating type, by the lists of `tile_lists`.

    limits: alpha_min, alpha_max, transmittance_min
    Returns colours over black [tiles, 3, 16, 16], transmittances, and each pixel's last blended
    entry, counted from the start of its list, both [tiles, 16, 16].
    """
    tiles, kind = len(lists[1]) - 1, splats.dtype
    colour = np.empty((tiles, 3, TILE, TILE), kind)
    transmittance = np.empty((tiles, TILE, TILE), kind)
    last = np.empty_like(transmittance)
    _blend(
        splats, lists[1], lists[3], corners(width, height, kind), (width, height),
        np.array(limits, kind), TERMS.astype(kind), np.arange(TILE).astype(kind),
        numba.get_num_threads(), colour, transmittance, last,
    )  # fmt: skip
    return colour, transmittance, last


def blend_backward(splats, lists, width, height, limits, drawn, to_colour, to_rest):
    """Gradients [M, 9] by the splats, from gradients by the colours and transmittances of `blend`;
    `drawn`: transmittances and last entries from `blend`."""
    first, start, pair, owner = lists
    kind = splats.dtype
    pairs = np.zeros((len(pair), GRADIENTS), kind)
    _blend_backward(
        splats, start, pair, owner, corners(width, height, kind),
        np.array(limits, kind), TERMS.astype(kind), np.arange(TILE).astype(kind),
        numba.get_num_threads(), *drawn, to_colour, to_rest, pairs,
    )  # fmt: skip
    gradient = np.empty((len(splats), GRADIENTS), kind)
    _sum_pairs(first, pairs, gradient)
    return gradient


def corners(width: int, height: int, kind: np.dtype) -> np.ndarray:
    """Left and top pixel of each tile, [tiles, 2]."""
    rows, columns = -(-height // TILE), -(-width // TILE)
    y, x = np.divmod(np.arange(rows * columns), columns)
    return (np.stack([x, y], axis=1) * TILE).astype(kind)


@njit(cache=True, fastmath=FAST)
def _rows(splat, top):
    """First row of the tile that the splat's box touches, and the row after the last one."""
    low = max(int(np.ceil(splat[V] - splat[HIGH] - top)), 0)
    high = min(int(np.floor(splat[V] + splat[HIGH] - top)) + 1, TILE)
    return low, high


@njit(cache=True, fastmath=FAST, inline="always")
def _exponential(q, terms):
    """exp(−q/2), with the quadratic form clamped to 0 … REACH_MAX."""
    kind = terms.dtype.type
    x = kind(MIDDLE) - min(max(q, kind(0)), kind(REACH_MAX)) * kind(1 / 32)
    e = terms[6] + x * terms[7]
    e = terms[5] + x * e
    e = terms[4] + x * e
    e = terms[3] + x * e
    e = terms[2] + x * e
    e = terms[1] + x * e
    e = terms[0] + x * e
    e = e * e
    e = e * e
    e = e * e
    return e * e


@njit(parallel=True, cache=True, fastmath=FAST)
def _blend(
    splats, start, owner, corner, size, limits, terms, lanes, threads, colour, rest, last
):  # fmt: skip
    """Blend all tiles. A tile's state is one array, so that the compiler can rule out aliasing:
    colour, transmittance, whether the pixel is live, and its last blended entry in the list."""
    alpha_min, alpha_max, rest_min = limits[0], limits[1], limits[2]
    zero, one, two = lanes[0], lanes[1], lanes[2]
    for thread in prange(threads):
        state = np.empty((6, TILE, TILE), splats.dtype)
        for tile in range(thread, len(start) - 1, threads):
            left, top = corner[tile, 0], corner[tile, 1]
            state[:3], state[3], state[5] = zero, one, -one
            for y in range(TILE):
                for x in range(TILE):
                    within = (left + x < size[0]) & (top + y < size[1])
                    state[4, y, x] = one if within else zero
            number = zero
            for entry in range(start[tile], start[tile + 1]):
                if entry % PATIENCE == 0 and not state[4].any():
                    break
                s = splats[owner[entry]]
                a, b, c, opacity, reach = s[A], s[B], s[C], s[OPACITY], s[REACH]
                red, green, blue = s[RED], s[GREEN], s[BLUE]
                slack = c - b * b / a
                low, high = _rows(s, top)
                for y in range(low, high):
                    dy = top + lanes[y] - s[V]
                    if slack * dy * dy > reach:
                        continue
                    x0, linear, constant = left - s[U], two * b * dy, c * dy * dy
                    for x in range(TILE):
                        dx = x0 + lanes[x]
                        q = (a * dx + linear) * dx + constant
                        alpha = min(opacity * _exponential(q, terms), alpha_max)
                        t, live = state[3, y, x], state[4, y, x]
                        weight = t * alpha
                        meets = (q <= reach) & (alpha >= alpha_min) & (live > zero)
                        ends = meets & (t - weight < rest_min)
                        blends = meets & (t - weight >= rest_min)
                        weight = weight if blends else zero
                        state[0, y, x] += weight * red
                        state[1, y, x] += weight * green
                        state[2, y, x] += weight * blue
                        state[3, y, x] = t - weight
                        state[4, y, x] = zero if ends else live
                        state[5, y, x] = number if blends else state[5, y, x]
                number += one
            colour[tile] = state[:3]
            rest[tile] = state[3]
            last[tile] = state[5]


@njit(parallel=True, cache=True, fastmath=FAST)
def _blend_backward(
    splats, start, pair, owner, corner, limits, terms, lanes, threads, rest, last,
    to_colour, to_rest, pairs,
):  # fmt: skip
    """Compute the pairs' gradients, from back to front. With t the transmittance before a splat, g
    the pixel's gradient and `behind` = g·(colour blended behind the splat):
    d alpha = t·(g·colour) − behind / (1 − alpha)."""
    alpha_min, alpha_max = limits[0], limits[1]
    zero, one, two = lanes[0], lanes[1], lanes[2]
    for thread in prange(threads):
        sums = np.empty((GRADIENTS, TILE), splats.dtype)
        for tile in range(thread, len(start) - 1, threads):
            left, top = corner[tile, 0], corner[tile, 1]
            t, until = rest[tile].copy(), last[tile]
            behind = t * to_rest[tile]
            red, green, blue = to_colour[tile, 0], to_colour[tile, 1], to_colour[tile, 2]
            for place in range(int(until.max()), -1, -1):
                entry, number = start[tile] + place, splats.dtype.type(place)
                s = splats[owner[entry]]
                a, b, c, opacity, reach = s[A], s[B], s[C], s[OPACITY], s[REACH]
                shade_red, shade_green, shade_blue = s[RED], s[GREEN], s[BLUE]
                slack = c - b * b / a
                low, high = _rows(s, top)
                sums[:] = zero
                for y in range(low, high):
                    dy = top + lanes[y] - s[V]
                    if slack * dy * dy > reach:
                        continue
                    x0, linear, constant = left - s[U], two * b * dy, c * dy * dy
                    for x in range(TILE):
                        dx = x0 + lanes[x]
                        q = (a * dx + linear) * dx + constant
                        e = _exponential(q, terms)
                        free = opacity * e
                        alpha = min(free, alpha_max)
                        blends = (q <= reach) & (alpha >= alpha_min) & (until[y, x] >= number)
                        alpha = alpha if blends else zero
                        through = one / (one - alpha)
                        before = t[y, x] * through
                        weight = before * alpha
                        shade = (
                            shade_red * red[y, x] + shade_green * green[y, x]
                            + shade_blue * blue[y, x]
                        )  # fmt: skip
                        to_alpha = before * shade - behind[y, x] * through
                        to_alpha = to_alpha if blends & (free < alpha_max) else zero
                        behind[y, x] += weight * shade
                        t[y, x] = before
                        to_q = to_alpha * free  # times −½
                        sums[0, x] += to_q * dx
                        sums[1, x] += to_q * dy
                        sums[2, x] += to_q * dx * dx
                        sums[3, x] += to_q * dx * dy
                        sums[4, x] += to_q * dy * dy
                        sums[5, x] += to_alpha * e
                        sums[6, x] += weight * red[y, x]
                        sums[7, x] += weight * green[y, x]
                        sums[8, x] += weight * blue[y, x]
                _gather(sums, a, b, c, pairs[pair[entry]])


@njit(cache=True, fastmath=FAST)
def _gather(sums, a, b, c, g):
    """Compute a pair's gradients from the sums over each column of pixels."""
    for k in range(GRADIENTS):
        g[k] = sums[k].sum()
    across, down, xx, xy, yy = g[0], g[1], g[2], g[3], g[4]
    g[U], g[V] = a * across + b * down, b * across + c * down
    g[A], g[B], g[C] = -xx / 2, -xy, -yy / 2


@njit(parallel=True, cache=True)
def _sum_pairs(first, pairs, gradient):
    for m in prange(len(gradient)):
        gradient[m] = 0
        for p in range(first[m], first[m + 1]):
            for k in range(GRADIENTS):
                gradient[m, k] += pairs[p, k]
