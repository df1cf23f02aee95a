"""Golden model of stage 3: sorted entries of groups to 8-bit pixels, all in integers.

Threads share the groups. The numbers are the integers of `spec.raster`, so the result depends on no
order of work except the order of a pixel's splats.
"""

from typing import NamedTuple

import numpy as np

from splatcore.golden.setup import (
    FEATURE,
    LEVEL,
    LIBRARY,
    MACHINE,
    PAIRS,
    WORK,
    constants,
    levels,
    whole_features,
)
from splatcore.spec.colour import CHANNELS
from splatcore.spec.config import Config
from splatcore.spec.group import group_grid
from splatcore.spec.raster import BLOCKS, owner, power_table
from splatcore.spec.threads import shared
from splatcore.spec.work import pixel_bytes

GROUPS_PER_CHUNK = 8
"""Groups that a thread takes at a time; few, because list lengths vary."""


_rasterize = LIBRARY.function(
    "rasterize", int, int, FEATURE, np.int64, np.int64, np.int64, np.int64, MACHINE, np.int64,
    LEVEL, np.int32, None, WORK, PAIRS, np.int64,
)  # fmt: skip


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
    groups = rows * columns
    first = np.concatenate([[0], np.cumsum(np.bitwise_count(mask.astype(np.uint64)), dtype=int)])
    frame = Raster(
        np.zeros((height, width, pixel_bytes(rgba)), np.uint8 if rounded else np.int64),
        np.zeros((groups, config.rasterizers), WORK),
        np.zeros(groups, PAIRS),
        np.full(first[-1], -1, np.int64),
    )
    machine = constants(config)
    values = {"columns": columns, "width": width, "height": height, "rgba": rgba}
    values |= {"dropped": rounded * machine["visible"][0], "wide": not rounded}
    values |= zip(CHANNELS, (0, 0, 0) if rgba else background, strict=True)
    for name, value in values.items():
        machine[name] = value
    owners = np.array([owner(config, block) for block in range(BLOCKS**2)])
    table = np.array(power_table(config), np.int32)
    arrays = (
        whole_features(config, features), entries.start.astype(np.int64),
        entries.splat.astype(np.int64), mask, first, machine, owners, levels(config, mark_all),
        table, *frame,
    )  # fmt: skip

    def some(chosen: slice):
        _rasterize(chosen.start, min(chosen.stop, groups), *arrays)

    steps = range(0, groups, GROUPS_PER_CHUNK)
    for _ in shared(some, [slice(k, k + GROUPS_PER_CHUNK) for k in steps]):
        pass
    return frame
