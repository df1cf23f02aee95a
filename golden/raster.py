"""Golden model of stage 3: sorted entries of groups to 8-bit pixels, all in integers.

Compiled by numba, parallel over groups. The numbers are the integers of `spec.raster`, so the
result depends on no order of work except the order of a pixel's splats.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit, parallel_chunksize, prange

from splatcore.golden.setup import prepare, quadratic
from splatcore.spec import raster as stage_3
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.group import group_grid
from splatcore.spec.raster import BLOCKS, STEPS, owner

WORK = ("marked", "visited", "contributing", "contributions", "ended")
"""Counts by group and rasterizer.

marked: blocks that marking could not leave out
visited: marked blocks with a pixel of alpha ≥ 1/255
contributing: visited blocks with such a pixel that is live and not too faint
contributions: blended pixels
ended: pixels that ended
"""

PAIRS = ("entries", "pairs", "far", "empty")
"""Counts by group.

entries: entries until the group's last pixel ended
pairs: pairs of one of them and a tile with live pixels
far: pairs that setup found too far away
empty: pairs without a marked block
"""

GROUPS_PER_CHUNK = 8
"""Groups per chunk of parallel work; small, because list lengths vary."""

FAINT, ENDED, BLENDED = range(3)
"""Outcome of blending a splat into a pixel."""


@dataclass(frozen=True, eq=False)
class Entries:
    """Sorted entries of groups: group g has the entries start[g] … start[g + 1] − 1.

    start: [groups + 1] first entry of each group
    splat: [N] the splat's number
    mask: [N] tiles of the group that it reaches
    """

    start: np.ndarray
    splat: np.ndarray
    mask: np.ndarray

    def of(self, groups: np.ndarray) -> "Entries":
        """Return the entries of some groups, renumbered from 0."""
        spans = [np.arange(self.start[g], self.start[g + 1]) for g in groups]
        chosen = np.concatenate([np.zeros(0, np.int64), *spans])
        start = np.concatenate([[0], np.cumsum(np.diff(self.start)[groups])])
        return Entries(start, self.splat[chosen], self.mask[chosen])


@dataclass(frozen=True, eq=False)
class Raster:
    """A rasterized frame."""

    pixels: np.ndarray  # [H, W, 3] uint8, or unrounded sums (int64)
    work: np.ndarray  # [groups, rasterizers, len(WORK)] int64
    pairs: np.ndarray  # [groups, len(PAIRS)] int64
    # [tiles of all entries' masks] int64, in the order of the entries and their tiles: one bit per
    # marked block, from bit 16 on one per visited block; −1: the tile had no live pixel
    blocks: np.ndarray

    @property
    def counts(self) -> dict[str, int]:
        """Sums of the counts, by name."""
        counts = dict(zip(PAIRS, self.pairs.sum(0).tolist(), strict=True))
        return counts | dict(zip(WORK, self.work.sum((0, 1)).tolist(), strict=True))


def rasterize(
    config: Config,
    features: dict[str, np.ndarray],
    entries: Entries,
    size: tuple[int, int],
    background: tuple[int, int, int] = (0, 0, 0),
    mark_all: bool = False,
    rounded: bool = True,
) -> Raster:
    """Blend every group's entries, front to back.

    features: codes [M] of `spec.feature.feature_record`
    size: width and height, pixels
    background: codes of `spec.colour.colour_format`, red, green, blue
    mark_all: leave no block out, which must render the same picture
    rounded: False for the sums themselves, `sum_fraction` − 8 bits finer than pixels
    """
    (width, height), mask = size, entries.mask.astype(np.int64)
    rows, columns = group_grid(config, width, height)
    pixels = np.zeros((height, width, 3), np.uint8 if rounded else np.int64)
    work = np.zeros((rows * columns, config.rasterizers, len(WORK)), np.int64)
    pairs = np.zeros((rows * columns, len(PAIRS)), np.int64)
    owners = np.array([owner(config, block)[0] for block in range(BLOCKS**2)])
    tiles = np.concatenate([[0], np.cumsum(np.bitwise_count(mask.astype(np.uint64)), dtype=int)])
    blocks = np.full(tiles[-1], -1, np.int64)
    with parallel_chunksize(GROUPS_PER_CHUNK):
        _rasterize_groups(
            prepare(config, features), entries.start, entries.splat.astype(np.int64), mask,
            np.array([columns, config.group]), owners, config.exponent_fraction,
            _blend_constants(config, rounded), _levels(config, mark_all),
            np.array(stage_3.power_table(config)),
            np.array(background), pixels, work, pairs, tiles, blocks,
        )  # fmt: skip
    return Raster(pixels, work, pairs, blocks)


def _levels(config: Config, mark_all: bool) -> np.ndarray:
    """Return [levels, 2] for each level of a block (`spec.raster.mark_min`): the T from which on
    its level is lower, and twice the E from which on it is marked.
    """
    least = 2 * np.array(stage_3.mark_min(config))
    if mark_all:
        least = np.full(1, -(1 << 62))
    from_, *_ = config.faint or (0,)
    above = [1 << config.transmittance - from_ - k for k in range(len(least) - 1)]
    return np.stack([np.array([*above, 0]), least], axis=1)


def _blend_constants(config: Config, rounded: bool) -> tuple[int, ...]:
    """Return the constants of a machine for the loops below."""
    pixel, bits = config.pixel_fraction, config.transmittance
    from_, below, _ = config.faint or (bits, bits, 0)
    return (
        1 << bits - from_ if config.faint else 0, stage_3.exponent_min(pixel),
        config.exponent_fraction + 2 - pixel, pixel - config.power_fraction,
        config.power_fraction, config.power_mantissa, config.transmittance,
        stage_3.transmittance_min(config), config.transmittance - config.weight,
        config.weight + config.colour_fraction - config.sum_fraction,
        config.sum_fraction - 8 if rounded else 0, config.sum_fraction - 8,
        1 << bits - below, int(bool(config.faint)),
    )  # fmt: skip


@njit(parallel=True, cache=True)
def _rasterize_groups(
    splats, start, splat, mask, grid, owners, setup, blending, levels, table, background,
    pixels, work, pairs, first, blocks,
):  # fmt: skip
    """Rasterize all groups; writes `pixels`, `work`, `pairs` and `blocks`."""
    columns, tiles = grid
    side = tiles * TILE
    height, width = pixels.shape[:2]
    for group in prange(len(start) - 1):
        row, column = group // columns * tiles, group % columns * tiles
        # per pixel: T, red, green, blue, 1 if it is live
        state = np.zeros((side, side, 5), np.int64)
        state[:, :, 0] = (1 << blending[6]) - 1
        state[: height - row * TILE, : width - column * TILE, 4] = 1
        live = np.zeros((side // BLOCK, side // BLOCK), np.int64)  # live pixels per block
        for y in range(side):
            for x in range(side):
                live[y // BLOCK, x // BLOCK] += state[y, x, 4]
        left = live.sum()
        level = np.zeros_like(live)
        coefficients = np.zeros(6, np.int64)
        for k in range(start[group], start[group + 1]):
            if left == 0:
                break
            pairs[group, 0] += 1
            prepared = splats[splat[k]]
            pair = first[k] - 1
            for tile in range(tiles * tiles):
                y, x = tile // tiles * BLOCKS, tile % tiles * BLOCKS
                alive = live[y : y + BLOCKS, x : x + BLOCKS]
                if not mask[k] >> tile & 1:
                    continue
                pair += 1
                if alive.sum() == 0:
                    continue
                blocks[pair] = 0
                pairs[group, 1] += 1
                at = column + tile % tiles, row + tile // tiles
                if not quadratic(prepared, at[0], at[1], setup, coefficients):
                    pairs[group, 2] += 1
                    continue
                area = state[y * BLOCK : y * BLOCK + TILE, x * BLOCK : x * BLOCK + TILE]
                blocks[pair], ended = _blend_tile(
                    coefficients, prepared, area, alive, level[y : y + BLOCKS, x : x + BLOCKS],
                    blending, levels, table, owners, work[group],
                )  # fmt: skip
                pairs[group, 3] += blocks[pair] == 0
                left -= ended
        for y in range(min(side, height - row * TILE)):
            for x in range(min(side, width - column * TILE)):
                _finish(
                    state[y, x], background, blending, pixels[row * TILE + y, column * TILE + x]
                )


@njit(cache=True)
def plane(coefficients, p, q):
    """Return E and its slopes at (2p, 2q) from a tile's centre, the centre of a block."""
    e, gx, gy, cxx, cxy, cyy = coefficients
    centre = e + 2 * (gx * p + gy * q) - 4 * (cxx * p * p - cxy * p * q + cyy * q * q)
    return centre, gx - 4 * cxx * p + 2 * cxy * q, gy - 4 * cyy * q + 2 * cxy * p


@njit(cache=True)
def _blend_tile(coefficients, splat, area, alive, level, blending, levels, table, owners, work):
    """Blend a splat into a tile.

    area: [16, 16, 5] the tile's pixels
    alive: [4, 4] live pixels of each block
    level: [4, 4] level of each block
    Returns the marked and visited blocks, and the number of pixels that ended.
    """
    _, _, _, cxx, cxy, cyy = coefficients
    coarser = blending[2]
    blocks = ended = 0
    for row in range(BLOCKS):
        for column in range(BLOCKS):
            p, q = STEPS[column], STEPS[row]
            if not alive[row, column]:
                continue
            centre, slope_x, slope_y = plane(coefficients, p, q)
            # E is concave: in the whole block it is below its tangent plane at the centre.
            if 2 * centre + 3 * (abs(slope_x) + abs(slope_y)) < levels[level[row, column], 1]:
                continue
            blocks |= 1 << row * BLOCKS + column
            exponents = (
                4 * centre >> coarser, 2 * slope_x >> coarser, 2 * slope_y >> coarser,
                cxx >> coarser, cxy >> coarser, cyy >> coarser,
            )  # fmt: skip
            did = work[owners[row * BLOCKS + column]]
            visited, gone, most = _blend_block(
                exponents, splat[16:19],
                area[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK],
                blending, table, did,
            )  # fmt: skip
            while most < levels[level[row, column], 0]:
                level[row, column] += 1
            blocks |= visited << 16 + row * BLOCKS + column
            alive[row, column] -= gone
            ended += gone
    return blocks, ended


@njit(cache=True)
def _blend_block(exponents, colour, block, blending, table, work):
    """Blend a splat into a block's pixels [4, 4, 5].

    Returns 1 if a pixel has alpha ≥ 1/255, the number of pixels that ended, and the largest T of
    the live pixels.
    """
    base, along_x, along_y, xx, xy, yy = exponents
    lowest = blending[1]
    visited = contributing = False
    ended = most = 0
    for j in range(BLOCK):
        for i in range(BLOCK):
            a, b = STEPS[i], STEPS[j]
            exponent = base + along_x * a + along_y * b - xx * a * a + xy * a * b - yy * b * b
            if exponent >= lowest:
                visited = True
                if block[j, i, 4]:
                    did = _blend(block[j, i], min(exponent, -1), colour, blending, table)
                    contributing |= did != FAINT
                    work[3] += did == BLENDED
                    ended += not block[j, i, 4]
            if block[j, i, 4]:
                most = max(most, block[j, i, 0])
    work[0] += 1
    work[1] += visited
    work[2] += contributing
    work[4] += ended
    return int(visited), ended, most


@njit(cache=True)
def _blend(pixel, exponent, colour, blending, table):
    """Blend a splat with log2(alpha) < 0 into a pixel, or end it; return the outcome."""
    finer, steps, mantissa, rest_min, narrower, product = (
        blending[3], blending[4], blending[5], blending[7], blending[8], blending[9],
    )  # fmt: skip
    exponent >>= finer
    halvings = -1 - (exponent >> steps)
    taken = pixel[0] * table[exponent & ((1 << steps) - 1)] >> mantissa + halvings
    if pixel[0] < blending[0] and taken < blending[12]:
        return FAINT
    rest = pixel[0] - taken
    if rest < rest_min:
        pixel[4] = 0
        if not blending[13]:
            return ENDED
        rest = 0
    weight = (pixel[0] >> narrower) - (rest >> narrower)
    pixel[0] = rest
    for channel in range(3):
        pixel[1 + channel] += weight * colour[channel] + (1 << product - 1) >> product
    return BLENDED


@njit(cache=True)
def _finish(pixel, background, blending, out):
    """Write a pixel's colour over the background, at most 255, rounded to nearest."""
    narrower, product, dropped, finer = blending[8], blending[9], blending[10], blending[11]
    weight = pixel[0] >> narrower
    for channel in range(3):
        total = pixel[1 + channel] + (weight * background[channel] + (1 << product - 1) >> product)
        most = 255 << finer - dropped
        out[channel] = min(total + (1 << dropped >> 1) >> dropped, most)
