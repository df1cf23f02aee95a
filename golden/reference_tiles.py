"""The reference renderer's inner loops: the tiles that a splat touches, and blending a tile.

In C++ (`reference.cpp`). Threads share the rows of tiles. One thread computes a tile in a fixed
order, so the result does not depend on the number of threads.
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from splatcore.spec.convention import BLOCK, TILE, Convention, Faint
from splatcore.spec.native import Library
from splatcore.spec.progress import report
from splatcore.spec.threads import shared

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


LIMITS = np.dtype(
    [(name, np.float64) for name in "alpha_min alpha_max dark taken ends takes_all slack".split()]
)
"""A convention's thresholds: of alpha, and as in `Faint`; dark is 0 without a rule.

takes_all: a pixel's last splat takes all of T
slack: `SLACK`
"""

LIBRARY = Library(
    Path(__file__).with_name("reference.cpp"),
    {"BLOCK": BLOCK, "TILE": TILE},
    {"Work": WORK, "Limits": LIMITS},
)

_reals, _integers, _numbers = np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.int32)
_visit_tiles = LIBRARY.function(
    "visit_tiles", int, *[_reals] * 3, _numbers, _integers, _integers, _numbers
)
_blend_tiles = LIBRARY.function(
    "blend_tiles", int, int, _integers, _integers, _numbers, *[_reals] * 6, LIMITS, _reals, _reals,
    WORK,
)  # fmt: skip
_smallest_q = LIBRARY.function("smallest_q", int, _reals, _reals, _reals)


def bin_splats(splats, boxes, width: int, height: int, exact: bool) -> TileLists:
    """Return lists of the tiles in `boxes` [M, 4]; if `exact`, only of tiles really reached."""
    arrays = [np.ascontiguousarray(some) for some in (splats.centre, splats.conic, splats.reach)]
    boxes = np.ascontiguousarray(boxes, np.int32)
    lengths = np.zeros(-(-width // TILE) * -(-height // TILE), np.int64)

    def visit(slot: np.ndarray, splat: np.ndarray):
        sizes = np.array([width, height, exact, len(splat)])
        _visit_tiles(len(boxes), *arrays, boxes, sizes, slot, splat)

    visit(lengths, np.empty(0, np.int32))
    start = np.concatenate([[0], np.cumsum(lengths)])
    splat = np.empty(start[-1], np.int32)
    visit(start[:-1].copy(), splat)
    return TileLists(start, splat)


def smallest_q(conic: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the minima [N] of A·x² + 2·B·x·y + C·y² over rectangles [x0, x1] × [y0, y1].

    conic: [N, 3] A, B, C
    edges: [N, 4] x0, x1, y0, y1
    """
    found = np.empty(len(conic))
    _smallest_q(len(conic), conic, edges, found)
    return found


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
    limits = convention.alpha_min, convention.alpha_max, *rule, takes_all, SLACK
    names = "centre conic opacity reach extent colour".split()
    arrays = [np.ascontiguousarray(getattr(splats, name), np.float64) for name in names]
    arrays = lists.start, lists.splat, *arrays, np.array([limits], LIMITS), *found
    progress, sizes = progress or partial(report, "tiles"), np.array([width, height])

    def blend(chosen: slice):
        _blend_tiles(chosen.start * columns, chosen.stop * columns, sizes, *arrays)

    for row, _ in enumerate(shared(blend, [slice(row, row + 1) for row in range(rows)]), 1):
        progress(row * columns, rows * columns)
    return found
