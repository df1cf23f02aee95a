"""Cycles of stage 3, traced pair by pair: alone, or between stage 2 and memory.

Only queues are modelled: the rasterizers' input queues decide how much of their work overlaps, the
other queues how much of sorting and writing overlaps with stage 3.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from splatcore.golden.pipeline import Frame
from splatcore.hdl.raster.blend import Blend
from splatcore.hdl.raster.evaluate import Evaluate
from splatcore.hdl.raster.features import WAITING
from splatcore.hdl.raster.mark import Mark
from splatcore.hdl.raster.quads import SHARE
from splatcore.hdl.raster.rasterizer import PAIRS_WAITING
from splatcore.hdl.raster.setup import Setup
from splatcore.sim.cycles.quads import quads_cycles
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

PASSES = 8
NEAR = 0.002
"""Cycles per block of lanes in quads are found in at most `PASSES` passes, so that the cycles of
stage 3 are within `NEAR`, relative."""

CLOCK = np.dtype([(name, float) for name in "entered marked merged end".split()])
"""Cycles of stage 3: of the last splat's arrival, marked pair and merged entry, and of the last
group's end."""

RASTERIZER = np.dtype(
    [
        ("free", float),  # when it can issue its next block
        ("begun", float, PAIRS_HELD),  # when its last pairs left
        ("count", np.int64),  # pairs so far
        ("last", np.int64, BUSY),  # last visited blocks
        ("lanes", float, BUSY),  # when they entered the lanes
        ("owed", float),  # blocks of the previous group still to be emitted
        ("gone", float),  # when the last one was emitted
    ]
)
"""A rasterizer."""


class Work(NamedTuple):
    """A frame's entries and pairs (`golden.raster`)."""

    mask: np.ndarray  # [N] tiles of each entry
    blocks: np.ndarray  # marked and visited blocks per tile, −1 for none
    first: np.ndarray  # [N + 1] each entry's first place in `blocks`
    owners: np.ndarray  # [blocks of a tile] their rasterizers
    step: float  # cycles per block


class State(NamedTuple):
    """The queues of stage 3."""

    clock: np.ndarray  # [1] of `CLOCK`
    rasterizers: np.ndarray  # of `RASTERIZER`
    visited: np.ndarray  # [blocks of a group] whether they were visited in this group
    room: np.ndarray  # [blocks of a group] when each has room
    left: np.ndarray  # [SPLATS_INSIDE] when the last splats with live tiles left for setup
    splats: np.ndarray  # [1] number of splats with live tiles
    taken: np.ndarray  # [WAITING] when the last splats arrived


class Raster:
    """Stage 3 of a frame, with block-wide lanes. number: the next group; at: the next entry.

    step: cycles per block
    """

    def __init__(self, config: Config, frame: Frame, step: float = 1):
        mask, blocks = frame.sorted.mask.astype(np.int64), BLOCKS_A_TILE * config.group**2
        first = np.concatenate([[0], np.cumsum(np.bitwise_count(mask), dtype=np.int64)])
        owners = np.array([owner(config, block) for block in range(BLOCKS_A_TILE)])
        self.work = Work(mask, frame.raster.blocks, first, owners, step)
        self.start, self.group_blocks = frame.start, block_count(config)
        self.number = self.at = self.live_end = 0
        self.order = order(config)  # each block's share of its rasterizer's, as they are written
        self.state = State(
            np.zeros(1, CLOCK), np.zeros(config.rasterizers, RASTERIZER), np.zeros(blocks, bool),
            np.zeros(blocks), np.zeros(SPLATS_INSIDE), np.zeros(1, np.int64),
            np.zeros(WAITING),
        )  # fmt: skip
        self.clock, self.rasterizers = self.state.clock[0], self.state.rasterizers
        self.clock["marked"], self.rasterizers["last"] = PAIR_LATENCY, -1

    def entries(self, count: int, merged: float = 0, pace: float = 0, far: float = 0) -> float:
        """Trace the group's next entries; the cycle in which the last one is merged.

        count: number of entries
        merged: cycle in which the first can be merged
        pace: cycles per entry; 0 if entries are always available
        far: cycles from merging an entry to its splat's arrival
        """
        self.clock["merged"] = merged - pace
        if self.at == self.start[self.number]:
            self.live_end = live_end(self.at, self.start[self.number + 1], self.work)
        first, self.at = self.at, self.at + count
        pass_splats(first, self.at, self.live_end, pace, far, self.work, self.state)
        return self.clock["merged"]

    def write(self, begin: float, cycles: float):
        """Write the finished blocks from cycle `begin` on, within `cycles`."""
        self.state.room[:] = begin + self.order * cycles

    def end(self) -> float:
        """End the group; the cycle in which the previous group's last block was emitted."""
        self.number += 1
        return end_group(self.group_blocks, self.state)


def block_wide(config: Config, frame: Frame, cycles: int) -> tuple[Config, float]:
    """Return a machine of as many block-wide lanes, and its cycles per block: for lanes in quads an
    average, so that both machines take as long without stalls.

    cycles: of stage 3 alone (`raster_cycles`)
    """
    if config.lanes == "block":
        return config, 1.0
    wide = replace(config, lanes="block", rasterizers=config.rasterizers // SHARE)
    step, found, following = 0.0, 0, 1.0
    for _ in range(PASSES):  # by secants
        before, known = step, found
        step, found = following, raster_cycles(wide, frame, following)
        if abs(found - cycles) <= NEAR * cycles or found == known:
            break
        following = max(0.0, step + (cycles - found) * (step - before) / (found - known))
    return wide, step


def order(config: Config) -> np.ndarray:
    """Share of a rasterizer's blocks written up to each block of a group, that block included."""
    found = np.zeros((config.group**2, BLOCKS_A_TILE))
    for rasterizer in range(config.rasterizers):
        own = np.array(owned(config, rasterizer))
        for number in range(block_count(config)):
            tile, block = divmod(nth_block(config, number), len(own))
            found[tile, own[block]] = (number + 1) / block_count(config)
    return found.ravel()


def raster_cycles(config: Config, frame: Frame, step: float = 1) -> int:
    """Cycles of stage 3 alone with splats always valid, until it emits its last block.

    Groups without a splat bypass it. step: cycles per block of block-wide lanes
    """
    if config.lanes == "quads":
        return quads_cycles(config, frame)
    stage = Raster(config, frame, step)
    for count in np.diff(frame.start):
        if count:
            stage.entries(count)
            stage.end()
        else:
            stage.number += 1
    return int(stage.rasterizers["free"].max() + stage.group_blocks + BLOCK_LATENCY)


@njit(cache=True)
def idle(rasterizer, until):
    """Let a rasterizer emit blocks of the previous group while it is idle."""
    emitted = min(max(until - rasterizer.free, 0), rasterizer.owed)
    if emitted > 0:
        rasterizer.owed -= emitted
        rasterizer.gone = rasterizer.free + emitted


@njit(cache=True)
def end_group(blocks, state):
    """End a group: each rasterizer owes its blocks; the cycle of the previous group's last one."""
    clock, room = state.clock[0], state.room.max()
    clock.marked += 1
    clock.end = gone = 0.0
    for r in range(len(state.rasterizers)):
        one = state.rasterizers[r]
        end = max(clock.marked + QUEUE_LATENCY, one.free)
        idle(one, end)
        end += one.owed
        one.gone = max(end if one.owed > 0 else one.gone, room)
        end = max(end, one.gone + WRITE_LATENCY)  # none is in flight any more
        one.free = max(one.free + TURN, end + END_TURN)
        one.owed, one.begun[one.count % PAIRS_HELD] = blocks, one.free
        one.count += 1
        clock.end, gone = max(clock.end, end), max(gone, one.gone)
    state.visited[:] = False
    return gone


@njit(cache=True)
def pass_splats(first, end, ended, pace, far, work, state):
    """Trace a group's entries first … end through the queues.

    ended: first entry after which all tiles have ended
    pace, far: as in `Raster.entries`
    """
    clock, taken, left, splats = state.clock[0], state.taken, state.left, state.splats[0]
    entered, marked, merged = clock.entered, clock.marked, clock.merged
    masks, blocks, places, owners, step = work
    for k in range(first, end):
        if pace > 0:
            if k == ended:
                last = state.rasterizers.free.max() + END_LATENCY
                merged = max(merged, min(merged + pace * (end - k), last))
            elif k < ended:
                merged = max(merged + pace, taken[k % len(taken)])
            entered = max(entered, merged + far - 1)
        entered = max(entered + 1, left[splats % SPLATS_INSIDE])
        taken[k % len(taken)] = entered
        dead, pair, tile, mask = True, places[k], 0, masks[k]
        while mask >> tile:
            if mask >> tile & 1:
                found = blocks[pair]
                pair += 1
                if found >= 0:
                    dead = False
                    marked = max(marked + 1, entered + PAIR_LATENCY)
                    marked = _deal(found, tile, marked, owners, step, state)
            tile += 1
        if not dead:
            left[splats % SPLATS_INSIDE] = marked - MARK_LATENCY
            splats += 1
    clock.entered, clock.marked, clock.merged, state.splats[0] = entered, marked, merged, splats


@njit(cache=True)
def live_end(first, end, work):
    """The entry after the last one with a live tile."""
    for k in range(end - 1, first - 1, -1):
        for pair in range(work.first[k], work.first[k + 1]):
            if work.blocks[pair] >= 0:
                return k + 1
    return first


@njit(cache=True)
def _deal(found, tile, marked, owners, step, state):
    """Push a pair to the rasterizers that own its blocks; the cycle in which all had room."""
    every, visited, room = state.rasterizers, state.visited, state.room
    for block in range(BLOCKS_A_TILE):
        if found >> block & 1:
            one = every[owners[block]]
            marked = max(marked, one.begun[one.count % PAIRS_HELD])
    for r in range(len(every)):
        one, some = every[r], False
        time = max(marked + QUEUE_LATENCY, one.free)
        for block in range(BLOCKS_A_TILE):
            if owners[block] != r or not found >> block & 1:
                continue
            if not some:
                idle(one, time)
            some = True
            if found >> BLOCKS_A_TILE + block & 1:
                time = _visit(one, tile * BLOCKS_A_TILE + block, time, visited, room)
            time += step
        if some:
            one.free = one.begun[one.count % PAIRS_HELD] = time
            one.count += 1
    return marked


@njit(cache=True)
def _visit(one, block, time, visited, room):
    """Issue a block to a rasterizer's lanes; the cycle in which it enters them."""
    if one.owed > 0 and not visited[block]:
        visited[block] = True
        time = max(time, room[block])
        one.owed -= 1
        one.gone = time
    last, lanes = one.last, one.lanes
    for back in range(BUSY):
        if last[back] == block:
            time = max(time, lanes[back] + BUSY)
    for back in range(BUSY - 1, 0, -1):
        last[back], lanes[back] = last[back - 1], lanes[back - 1]
    last[0], lanes[0] = block, time
    return time
