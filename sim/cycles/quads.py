"""Cycles of stage 3 with lanes in quads (`Config.lanes`), cycle by cycle, splats always valid."""

from pathlib import Path

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.hdl.lib.stream import Register
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.prepare import CUTS
from splatcore.hdl.raster.quads import OPERATIONS_WAITING, RESULT_CYCLES, SHARE, quad_of
from splatcore.hdl.raster.raster import SPLATS_WAITING
from splatcore.hdl.raster.rasterizer import PAIRS_WAITING, STAGES
from splatcore.hdl.raster.setup import Setup
from splatcore.sim.cycles.visits import (
    BLOCKS_A_TILE,
    MARK_BITS,
    NOT_SEEN,
    QUAD_BITS,
    UNSEEN,
    visits,
)
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK, TILE
from splatcore.spec.group import group_grid
from splatcore.spec.native import Library
from splatcore.spec.quads import QUADS, ended_level, halvings_min, quad_pixels
from splatcore.spec.raster import BLOCKS, nth_block, owned

# Cycles from the registers of stage 3.
BEGIN = len(CUTS) + Register.HOLDS  # from the first splat to its first pair
QUEUE_LATENCY = 2  # from an item entering a queue to its use
OUTPUT_LATENCY = QUEUE_LATENCY + Blend.LATENCY + 2  # from an operation to the block's output

MACHINE = np.dtype([
    (name, np.int64)
    for name in "groups columns width height group rasterizers ended".split()
])  # fmt: skip
"""A machine and a frame. groups: with splats; columns: of all groups."""

LIBRARY = Library(
    Path(__file__).with_name("quads.cpp"),
    {
        "TILE": TILE, "BLOCK": BLOCK, "BLOCKS": BLOCKS, "BLOCKS_A_TILE": BLOCKS_A_TILE,
        "QUADS": QUADS, "SHARE": SHARE, "QUAD_BITS": QUAD_BITS, "MARK_BITS": MARK_BITS,
        "UNSEEN": UNSEEN,
        "QUAD_FIRST": tuple(quad_pixels(quad)[0] for quad in range(QUADS)),
        "QUAD_OF": tuple(quad_of(k, quad) for k in range(SHARE) for quad in range(QUADS)),
        # instead of a pair or a visit; instead of a pair; instead of a visit
        "NOTHING": -1, "END": -2, "OUTPUT": -3,
        # from a pair's issue to its offer to the rasterizers
        "MARKED": Setup.LATENCY + Mark.LATENCY + 1,
        "SPLATS_INSIDE": SPLATS_WAITING + len(CUTS) - 1,  # before setup
        "PAIRS_WAITING": PAIRS_WAITING, "OPERATIONS_WAITING": OPERATIONS_WAITING,
        "STAGES": STAGES, "BUSY": Blend.BUSY, "RESULT_CYCLES": RESULT_CYCLES,
        "QUEUE_LATENCY": QUEUE_LATENCY,
        # from an operation entering the lanes to the use of its level
        "LEVEL_LATENCY": Blend.BUSY + 2,
    },
    {"Machine": MACHINE},
)  # fmt: skip

_run = LIBRARY.function(
    "run", np.int64, np.int64, np.int64, np.int64, np.int64, np.uint16, np.uint16, MACHINE,
    np.int64, np.int64, result=int,
)  # fmt: skip


def quads_cycles(config: Config, frame: Frame) -> int:
    """Cycles of stage 3 alone until it emits its last block."""
    groups = np.flatnonzero(np.diff(frame.start))
    if not len(groups):
        return 0
    height, width = frame.pixels.shape[:2]
    columns, ended = group_grid(config, width, height)[1], ended_level(config)
    numbers = len(groups), columns, width, height, config.group, config.rasterizers, ended
    order = _order(config)
    cycles = _run(
        groups, frame.start.astype(np.int64), frame.sorted.mask.astype(np.int64),
        *visits(config, frame), np.array([numbers], MACHINE),
        np.array([NOT_SEEN, *(halvings_min(config, k) for k in range(1, ended)), 0]), order,
    )  # fmt: skip
    return BEGIN + cycles + order.shape[1] + STAGES + OUTPUT_LATENCY


def _order(config: Config) -> np.ndarray:
    """Places [rasterizers, blocks] of each rasterizer's blocks of a group as they are output."""
    own = np.array([owned(config, number) for number in range(config.rasterizers)])
    places = np.arange(config.group**2)[:, None] * BLOCKS_A_TILE + own[:, None]
    places = places.reshape(config.rasterizers, -1)
    return places.take([nth_block(config, number) for number in range(places.shape[1])], axis=1)
