"""Golden model of stage 3: sorted entries of groups to 8-bit pixels, all in integers.

Compiled by numba, parallel over groups. The numbers are the integers of `spec.raster`, so the
result depends on no order of work except the order of a pixel's splats.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, parallel_chunksize, prange

from splatcore.golden.blend import blend_group, constants
from splatcore.golden.setup import prepare
from splatcore.spec.config import Config
from splatcore.spec.group import group_grid
from splatcore.spec.work import pixel_bytes


def _record(names: str) -> np.dtype:
    return np.dtype([(name, np.int64) for name in names.split()])


WORK = _record("marked visited contributing contributions ended")
"""Counts by group and rasterizer.

marked: blocks that marking could not leave out
visited: marked blocks with a pixel of alpha ≥ 1/255
contributing: visited blocks with such a pixel that is live and not too faint
contributions: blended pixels
ended: pixels that ended
"""

PAIRS = _record("entries pairs far empty")
"""Counts by group.

entries: entries until the group's last pixel ended
pairs: pairs of one of them and a tile with live pixels
far: pairs that setup found too far away
empty: pairs without a marked block
"""

GROUPS_PER_CHUNK = 8
"""Groups per chunk of parallel work; small, because list lengths vary."""


class Entries(NamedTuple):
    """Sorted entries of groups: group g has the entries start[g] … start[g + 1] − 1."""

    start: np.ndarray  # [groups + 1] first entry of each group
    splat: np.ndarray  # [N] the splat's number
    mask: np.ndarray  # [N] tiles of the group that it reaches

    def of(self, groups: np.ndarray) -> "Entries":
        """Return the entries of some groups, renumbered from 0."""
        spans = [np.arange(self.start[g], self.start[g + 1]) for g in groups]
        chosen = np.concatenate([np.zeros(0, np.int64), *spans])
        start = np.concatenate([[0], np.cumsum(np.diff(self.start)[groups])])
        return Entries(start, self.splat[chosen], self.mask[chosen])


class Raster(NamedTuple):
    """A rasterized frame."""

    # [H, W, 3] uint8, or unrounded sums (int64); [H, W, 4] with alpha, the colour premultiplied
    pixels: np.ndarray
    work: np.ndarray  # [groups, rasterizers] of `WORK`
    pairs: np.ndarray  # [groups] of `PAIRS`
    # [tiles of all entries' masks] int64, in the order of the entries and their tiles: one bit per
    # marked block, from bit 16 on one per visited block; −1: the tile had no live pixel
    blocks: np.ndarray

    @property
    def counts(self) -> dict[str, int]:
        """Sums of the counts, by name."""
        found = (self.pairs, self.work)
        return {name: int(some[name].sum()) for some in found for name in some.dtype.names}


def rasterize(
    config: Config,
    features: dict[str, np.ndarray],
    entries: Entries,
    size: tuple[int, int],
    background: tuple[int, int, int] = (0, 0, 0),
    rgba: bool = False,
    mark_all: bool = False,
    rounded: bool = True,
) -> Raster:
    """Blend every group's entries, front to back.

    features: codes [M] of `spec.feature.feature_record`
    size: width and height, pixels
    background: codes of `spec.colour.colour_format`, red, green, blue; ignored for `rgba`
    rgba: with alpha, always 8 bits, and without background
    mark_all: leave no block out, which must render the same picture
    rounded: False for the sums themselves, `sum_fraction` − 8 bits finer than pixels
    """
    (width, height), mask = size, entries.mask.astype(np.int64)
    rows, columns = group_grid(config, width, height)
    first = np.concatenate([[0], np.cumsum(np.bitwise_count(mask.astype(np.uint64)), dtype=int)])
    frame = Raster(
        np.zeros((height, width, pixel_bytes(rgba)), np.uint8 if rounded else np.int64),
        np.zeros((rows * columns, config.rasterizers), WORK),
        np.zeros(rows * columns, PAIRS),
        np.full(first[-1], -1, np.int64),
    )
    entries = Entries(entries.start, entries.splat.astype(np.int64), mask)
    machine = constants(config, background, mark_all, rounded, rgba)
    with parallel_chunksize(GROUPS_PER_CHUNK):
        _rasterize_groups(prepare(config, features), entries, first, columns, machine, frame)
    return frame


@njit(parallel=True, cache=True)
def _rasterize_groups(splats, entries, first, columns, machine, frame):
    """Rasterize all groups into `frame`. first: each entry's first place in `frame.blocks`."""
    for group in prange(len(entries.start) - 1):
        blend_group(group, splats, entries, first, columns, machine, frame)
