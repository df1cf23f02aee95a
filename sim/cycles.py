"""Cycles of each stage from a machine's sizes and its twins' counts, without the RTL.

Each stage by itself: its inputs are always there, its outputs are always taken. What a chunk, a
point, a splat, an entry or a block costs is counted; only the queues in front of the rasterizers
are followed pair by pair, as they decide how much of one's work hides behind another's.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from golden.pipeline import Frame
from golden.sort_cycles import cycles as sort_cycles
from hdl.blend import Blend
from hdl.evaluate import Evaluate
from hdl.mark import Mark
from hdl.rasterizer import PAIRS_WAITING
from hdl.setup import Setup
from spec.config import Config
from spec.microprogram import culling, program, projection
from spec.raster import BLOCKS, block_count, owner
from spec.schedule import schedule

BLOCKS_A_TILE = BLOCKS**2

SET_UP = 3  # of a splat in binning

# Cycles as the registers and states of stage 3 make them.
PAIR_LATENCY = 19  # from a splat's coming to its first pair's being marked
QUEUE_LATENCY = 2  # from a pair's entering a rasterizer's queue to its first block
BLOCK_LATENCY = 1 + Evaluate.LATENCY  # from a block's being issued to the lanes
TURN = 7  # from a group's last block being given out to the next group's first
PAIRS_HELD = PAIRS_WAITING + 1  # of a rasterizer, the one at hand included
SPLATS_INSIDE = 20  # splats before setup
MARK_LATENCY = Setup.LATENCY + Mark.LATENCY
BUSY = Blend.BUSY  # before a block may come again


@dataclass(frozen=True)
class Cycles:
    """Cycles of a frame by stage."""

    chunk: int
    cull: int
    place: int
    project: int
    bin: int
    sort: int
    raster: int

    @property
    def preprocessing(self) -> int:
        """Stages 0 and 1 and binning, at work at once."""
        return max(self.chunk, self.cull, self.place, self.project, self.bin)

    @property
    def rendering(self) -> int:
        """Stages 2 and 3, at work at once."""
        return max(self.sort, self.raster)

    @property
    def frame(self) -> int:
        """Both halves, at work at once on neighbouring frames."""
        return max(self.preprocessing, self.rendering)


def frame_cycles(config: Config, frame: Frame) -> Cycles:
    """Cycles of a frame that the twins have made."""
    points = frame.points
    bounds = schedule(config, program("chunk"))  # a chunk at a time is in its array
    intervals = {
        "chunk": (bounds.length // bounds.interval + 1) * bounds.interval,
        "cull": schedule(config, culling(config.depth_interval)).interval,
        "place": schedule(config, program("place")).interval,
        "project": schedule(config, projection(config.sh_degree, config.skip_zeros)).interval,
    }
    return Cycles(
        chunk=len(points.read) * intervals["chunk"],
        cull=len(points.points) * intervals["cull"],
        place=len(points.front) * intervals["place"],
        project=len(points.index) * intervals["project"],
        bin=bin_cycles(config, frame),
        sort=sort_cycles(config, np.diff(frame.start)),
        raster=raster_cycles(config, frame),
    )


def bin_cycles(config: Config, frame: Frame) -> int:
    """Binning: what each splat takes longest, set-up, tile rows or entries; and all lists' ends."""
    binned = frame.binned
    longest = np.maximum(binned.splat_rows, binned.splat_entries)
    return int(np.maximum(longest, SET_UP).sum()) + len(binned.lists.count)


def raster_cycles(config: Config, frame: Frame) -> int:
    """Stage 3, its splats always there."""
    mask = frame.binned.entries["mask"][frame.order]
    owners = np.array([owner(config, block)[0] for block in range(BLOCKS_A_TILE)])
    return int(
        raster_time(
            frame.start, mask.astype(np.int64), frame.raster.blocks, owners, config.rasterizers,
            block_count(config),
        )
    )  # fmt: skip


@njit(cache=True)
def raster_time(start, mask, blocks, owners, rasterizers, drained):
    """When the last block is given out.

    start [groups + 1]: entries of each group; mask [N]: tiles of each entry; blocks: marked and
    visited ones of each of these tiles, −1 for none (`golden.raster.Raster.blocks`).
    """
    entered = 0.0  # when the last splat came
    marked = float(PAIR_LATENCY)  # when the last pair was marked
    free = np.zeros(rasterizers)  # when a rasterizer can issue its next block
    begun = np.zeros((rasterizers, PAIRS_HELD))  # when its last pairs left the queue
    count = np.zeros(rasterizers, np.int64)
    last = np.full((rasterizers, BUSY), -1)  # its last visited blocks
    lanes = np.zeros((rasterizers, BUSY))  # when they entered the lanes
    left = np.zeros(SPLATS_INSIDE)  # when the last splats with live tiles left for setup
    pair = splats = 0
    for group in range(len(start) - 1):
        for k in range(start[group], start[group + 1]):
            entered = max(entered + 1, left[splats % SPLATS_INSIDE])
            dead, tile, tiles = True, 0, mask[k]
            while tiles >> tile:
                if tiles >> tile & 1:
                    found = blocks[pair]
                    pair += 1
                    if found >= 0:
                        dead = False
                        marked = max(marked + 1, entered + PAIR_LATENCY)
                        marked = _deal(found, tile, marked, owners, free, begun, count, last, lanes)
                tile += 1
            if not dead:
                left[splats % SPLATS_INSIDE] = marked - MARK_LATENCY
                splats += 1
        marked += 1
        for r in range(rasterizers):
            free[r] = max(marked + QUEUE_LATENCY, free[r]) + drained + TURN
            begun[r, count[r] % PAIRS_HELD] = free[r]
            count[r] += 1
    return free.max() + BLOCK_LATENCY


@njit(cache=True)
def _deal(found, tile, marked, owners, free, begun, count, last, lanes):
    """A pair to the rasterizers that own its blocks; when it went, all of them having room."""
    for block in range(BLOCKS_A_TILE):
        if found >> block & 1:
            r = owners[block]
            marked = max(marked, begun[r, count[r] % PAIRS_HELD])
    for r in range(len(free)):
        now, some = max(marked + QUEUE_LATENCY, free[r]), False
        for block in range(BLOCKS_A_TILE):
            if owners[block] != r or not found >> block & 1:
                continue
            some = True
            if found >> BLOCKS_A_TILE + block & 1:
                name = tile * BLOCKS_A_TILE + block
                for back in range(BUSY):
                    if last[r, back] == name:
                        now = max(now, lanes[r, back] + BUSY)
                for back in range(BUSY - 1, 0, -1):
                    last[r, back] = last[r, back - 1]
                    lanes[r, back] = lanes[r, back - 1]
                last[r, 0], lanes[r, 0] = name, now
            now += 1
        if some:
            free[r] = now
            begun[r, count[r] % PAIRS_HELD] = now
            count[r] += 1
    return marked
