"""Cycles of stage 3, traced pair by pair: alone, or between stage 2 and memory.

Only queues are modelled: the rasterizers' input queues decide how much of their work overlaps, the
other queues how much of sorting and writing overlaps with stage 3.
"""

import numpy as np
from numba import njit

from splatcore.golden.pipeline import Frame
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.hdl.raster.features import FEATURES_WAITING
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.rasterizer import PAIRS_WAITING
from splatcore.hdl.raster.setup import Setup
from splatcore.spec.config import Config
from splatcore.spec.raster import BLOCKS, block_count, nth_block, owned, owner

BLOCKS_A_TILE = BLOCKS**2

# Cycles from the registers and states of stage 3.
PAIR_LATENCY = 22  # from a splat's arrival to its first pair being marked
QUEUE_LATENCY = 2  # from a pair entering a rasterizer's queue to its first block
BLOCK_LATENCY = 1 + Evaluate.LATENCY  # from issuing a block to the lanes
TURN = 8  # minimum from after a group's last block to the next group's first block
END_TURN = 2  # minimum from the group's end to the next group's first block
WRITE_LATENCY = BLOCK_LATENCY + Blend.LATENCY + 2  # from issuing a block to writing it
PAIRS_HELD = PAIRS_WAITING + 1  # pairs in a rasterizer, the current one included
SPLATS_INSIDE = 20  # splats before setup
MARK_LATENCY = Setup.LATENCY + Mark.LATENCY
BUSY = Blend.BUSY  # cycles before the same block may be issued again
END_LATENCY = BLOCK_LATENCY + Blend.LATENCY + 4  # from a last pixel's block to stage 2 stopping

ENTERED, MARKED, PAIRS, SPLATS, MERGED, END = range(6)
"""Indices into `Raster.clock`: cycle of the last splat's arrival, cycle of the last marked pair,
number of pairs, number of splats with live tiles, cycle of the last merged entry, cycle of the last
group's end."""


class Raster:
    """Stage 3 of a frame. number: the next group; at: the next entry."""

    def __init__(self, config: Config, frame: Frame):
        self.start, self.mask = frame.start, frame.sorted.mask.astype(np.int64)
        self.blocks, self.group_blocks = frame.raster.blocks, block_count(config)
        self.owners = np.array([owner(config, block)[0] for block in range(BLOCKS_A_TILE)])
        self.number = self.at = self.live_end = 0
        self.clock = np.zeros(6)
        self.clock[MARKED] = PAIR_LATENCY
        self.free = np.zeros(config.rasterizers)  # when each can issue its next block
        self.begun = np.zeros((config.rasterizers, PAIRS_HELD))  # when their last pairs left
        self.count = np.zeros(config.rasterizers, np.int64)
        self.last = np.full((config.rasterizers, BUSY), -1)  # last visited blocks
        self.lanes = np.zeros((config.rasterizers, BUSY))  # when they entered the lanes
        # Blocks of the previous group still to be emitted, and when the last one was emitted.
        self.owed, self.gone = np.zeros((2, config.rasterizers))
        self.visited = np.zeros(BLOCKS_A_TILE * config.group**2, bool)  # in this group
        # When each block has room; its share of the rasterizer's blocks in the order of writing.
        self.room = np.zeros(len(self.visited))
        self.order = order(config)
        self.left = np.zeros(SPLATS_INSIDE)  # when the last splats with live tiles left for setup
        self.taken = np.zeros(FEATURES_WAITING)  # when the last splats arrived

    def entries(self, count: int, merged: float = 0, pace: float = 0, far: float = 0) -> float:
        """Trace the group's next entries; the cycle in which the last one is merged.

        count: number of entries
        merged: cycle in which the first can be merged
        pace: cycles per entry; 0 if entries are always available
        far: cycles from merging an entry to its splat's arrival
        """
        self.clock[MERGED] = merged - pace
        if self.at == self.start[self.number]:
            end, pair = self.start[self.number + 1], int(self.clock[PAIRS])
            self.live_end = live_end(self.at, end, pair, self.mask, self.blocks)
        first, self.at = self.at, self.at + count
        pass_splats(
            first, self.at, self.live_end, self.mask, self.blocks, self.owners,
            pace, far, self.clock, self.free, self.begun, self.count, self.last, self.lanes,
            self.owed, self.gone, self.visited, self.room, self.left, self.taken,
        )  # fmt: skip
        return self.clock[MERGED]

    def write(self, begin: float, cycles: float):
        """Write the finished blocks from cycle `begin` on, within `cycles`."""
        self.room = begin + self.order * cycles

    def end(self) -> float:
        """End the group; the cycle in which the previous group's last block was emitted."""
        self.clock[MARKED] += 1
        ends = np.maximum(self.clock[MARKED] + QUEUE_LATENCY, self.free)
        for r, at in enumerate(ends):
            idle(r, at, self.free, self.owed, self.gone)
        ends += self.owed
        self.gone[self.owed > 0] = ends[self.owed > 0]
        self.gone = np.maximum(self.gone, self.room.max())
        ends = np.maximum(ends, self.gone + WRITE_LATENCY)  # none is in flight any more
        self.clock[END] = ends.max()
        self.free = np.maximum(self.free + TURN, ends + END_TURN)
        self.owed[:], self.visited[:] = self.group_blocks, False
        for r, count in enumerate(self.count):
            self.begun[r, count % self.begun.shape[1]] = self.free[r]
        self.count += 1
        self.number += 1
        return self.gone.max()


def order(config: Config) -> np.ndarray:
    """Share of a rasterizer's blocks written up to each block of a group, that block included."""
    found = np.zeros((config.group**2, BLOCKS_A_TILE))
    for rasterizer in range(config.rasterizers):
        own = np.array(owned(config, rasterizer))
        for number in range(block_count(config)):
            tile, block = divmod(nth_block(config, number), len(own))
            found[tile, own[block]] = (number + 1) / block_count(config)
    return found.ravel()


def raster_cycles(config: Config, frame: Frame) -> int:
    """Cycles of stage 3 alone with splats always valid, until it emits its last block.

    Groups without a splat bypass it.
    """
    stage = Raster(config, frame)
    for count in np.diff(frame.start):
        if count:
            stage.entries(count)
            stage.end()
        else:
            stage.number += 1
    return int(stage.free.max() + stage.group_blocks + BLOCK_LATENCY)


@njit(cache=True)
def idle(r, until, free, owed, gone):
    """Let a rasterizer emit blocks of the previous group while it is idle."""
    emitted = min(max(until - free[r], 0), owed[r])
    if emitted > 0:
        owed[r] -= emitted
        gone[r] = free[r] + emitted


@njit(cache=True)
def pass_splats(
    first, end, ended, mask, blocks, owners,
    pace, far, clock, free, begun, count, last, lanes, owed, gone, visited, room,
    left, taken,
):  # fmt: skip
    """Trace a group's entries first … end through the queues.

    ended: first entry after which all tiles have ended
    mask: [N] tiles of each entry
    blocks: marked and visited blocks per tile, −1 for none (`golden.raster.Raster.blocks`)
    Updates `clock` and the arrays after it.
    """
    entered, marked, merged = clock[ENTERED], clock[MARKED], clock[MERGED]
    pair, splats = int(clock[PAIRS]), int(clock[SPLATS])
    for k in range(first, end):
        if pace > 0:
            if k == ended:
                merged = max(merged, min(merged + pace * (end - k), free.max() + END_LATENCY))
            elif k < ended:
                merged = max(merged + pace, taken[k % len(taken)])
            entered = max(entered, merged + far - 1)
        entered = max(entered + 1, left[splats % SPLATS_INSIDE])
        taken[k % len(taken)] = entered
        dead, tile, tiles = True, 0, mask[k]
        while tiles >> tile:
            if tiles >> tile & 1:
                found = blocks[pair]
                pair += 1
                if found >= 0:
                    dead = False
                    marked = max(marked + 1, entered + PAIR_LATENCY)
                    marked = _deal(
                        found, tile, marked, owners, free, begun, count, last, lanes,
                        owed, gone, visited, room,
                    )  # fmt: skip
            tile += 1
        if not dead:
            left[splats % SPLATS_INSIDE] = marked - MARK_LATENCY
            splats += 1
    clock[ENTERED], clock[MARKED], clock[MERGED] = entered, marked, merged
    clock[PAIRS], clock[SPLATS] = pair, splats


@njit(cache=True)
def live_end(first, end, pair, mask, blocks):
    """The entry after the last one with a live tile."""
    found = first
    for k in range(first, end):
        tiles = mask[k]
        while tiles:
            if tiles & 1:
                if blocks[pair] >= 0:
                    found = k + 1
                pair += 1
            tiles >>= 1
    return found


@njit(cache=True)
def _deal(
    found, tile, marked, owners, free, begun, count, last, lanes, owed, gone, visited, room
):  # fmt: skip
    """Push a pair to the rasterizers that own its blocks; the cycle in which all had room."""
    for block in range(BLOCKS_A_TILE):
        if found >> block & 1:
            r = owners[block]
            marked = max(marked, begun[r, count[r] % begun.shape[1]])
    for r in range(len(free)):
        time, some = max(marked + QUEUE_LATENCY, free[r]), False
        for block in range(BLOCKS_A_TILE):
            if owners[block] != r or not found >> block & 1:
                continue
            if not some:
                idle(r, time, free, owed, gone)
            some = True
            if found >> BLOCKS_A_TILE + block & 1:
                name = tile * BLOCKS_A_TILE + block
                if owed[r] > 0 and not visited[name]:
                    visited[name] = True
                    time = max(time, room[name])
                    owed[r] -= 1
                    gone[r] = time
                busy = last.shape[1]
                for back in range(busy):
                    if last[r, back] == name:
                        time = max(time, lanes[r, back] + busy)
                for back in range(busy - 1, 0, -1):
                    last[r, back] = last[r, back - 1]
                    lanes[r, back] = lanes[r, back - 1]
                last[r, 0], lanes[r, 0] = name, time
            time += 1
        if some:
            free[r] = time
            begun[r, count[r] % begun.shape[1]] = time
            count[r] += 1
    return marked
