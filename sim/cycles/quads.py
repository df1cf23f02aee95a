"""Cycles of stage 3 with lanes in quads (`Config.lanes`), cycle by cycle, splats always valid."""

import numpy as np
from numba import njit

from splatcore.golden.pipeline import Frame
from splatcore.hdl.raster.quads import RESULT_CYCLES, SHARE
from splatcore.hdl.raster.rasterizer import STAGES
from splatcore.sim.cycles.quads_state import (
    BEGIN,
    END,
    FEEDER,
    LEVEL_LATENCY,
    NOTHING,
    OUTPUT,
    OUTPUT_LATENCY,
    QUEUE_LATENCY,
    begun,
    machine_of,
    queues_of,
    state_of,
)
from splatcore.sim.cycles.visits import MARK_BITS, NOT_SEEN, QUAD_BITS, UNSEEN, visits
from splatcore.spec.config import Config
from splatcore.spec.quads import QUADS


def quads_cycles(config: Config, frame: Frame) -> int:
    """Cycles of stage 3 alone until it emits its last block."""
    found, order = visits(config, frame), np.flatnonzero(np.diff(frame.start))
    if not len(order):
        return 0
    machine = machine_of(config)
    feeders = np.zeros(config.rasterizers, FEEDER)
    feeders["visits"], feeders["group"], feeders["next"] = NOTHING, -1, len(machine.order)
    mask = frame.sorted.mask.astype(np.int64)
    pairs = np.concatenate([[0], np.cumsum(np.bitwise_count(mask), dtype=np.int64)])
    start = frame.sorted.start.astype(np.int64)
    work = (mask, pairs, start[order], start[order + 1], begun(config, frame, order))
    cycles = _run(found, work, machine, queues_of(machine), state_of(machine), feeders)
    return BEGIN + cycles + len(machine.order) + STAGES + OUTPUT_LATENCY


@njit(cache=True)
def _run(found, work, machine, queues, state, feeders):
    """Run until all groups have ended; return the cycle."""
    groups, cycle = len(work[2]), 0
    ended = 0
    state.at[4] = work[2][0]
    while ended < groups * len(feeders):
        cycle += 1
        for lanes in range(len(state.lanes)):
            for quad in range(QUADS):
                _lane(cycle, lanes, quad, found, machine, queues, state, feeders)
        for r in range(len(feeders)):
            if _send(cycle, r, found, machine, queues, state, feeders[r]):
                ended += _issue(cycle, r, found, work, machine, queues, state, feeders[r])
        if _deal(cycle, found, machine, queues, state, feeders):
            _expand(work, machine, state, feeders)
        _admit(work, machine, state, feeders)
    return cycle


@njit(cache=True)
def _lane(cycle, lanes, quad, found, machine, queues, state, feeders):
    """Take an operation from the longer of a quad's queues, if its block is not in flight."""
    half, flight, took = len(state.lanes), state.lanes[lanes, quad], NOTHING
    counts = [queues.count[lanes + k * half, machine.quads[k, quad]] for k in range(SHARE)]
    first = (cycle & 1) if counts[0] == counts[1] else int(counts[1] > counts[0])
    for turn in range(SHARE):
        k = first ^ turn
        r, own = lanes + k * half, machine.quads[k, quad]
        at = queues.head[r, own]
        if counts[k] == 0 or queues.came[r, own, at] + QUEUE_LATENCY > cycle:
            continue
        block, visit = queues.block[r, own, at], queues.visit[r, own, at]
        took = block * SHARE + k
        if (flight == took).any():
            took = NOTHING
            continue
        queues.head[r, own] = (at + 1) % queues.visit.shape[2]
        queues.count[r, own] -= 1
        feeders[r].last = cycle
        if visit >= 0:
            if state.since[r, block, own] <= cycle:
                state.before[r, block, own] = state.now[r, block, own]
            state.now[r, block, own] = found.levels[visit] >> QUAD_BITS * own & 15
            state.since[r, block, own] = cycle + LEVEL_LATENCY
        break
    flight[1:] = flight[:-1].copy()
    flight[0] = took


@njit(cache=True)
def _send(cycle, r, found, machine, queues, state, one):
    """Push the visit at the end of the pipeline to its quads; return whether it could leave."""
    visit, block, needs = one.visits[-1], one.blocks[-1], 0
    if visit != NOTHING:
        shows = visit >= 0 and found.halvings[visit] != UNSEEN
        whole = one.gives[-1] or (shows and not state.touched[r, block])
        least = machine.ended
        for quad in range(QUADS):
            known = state.since[r, block, quad] <= cycle
            level = state.now[r, block, quad] if known else state.before[r, block, quad]
            least = min(least, level)
            seen = NOT_SEEN if visit < 0 else found.halvings[visit] >> QUAD_BITS * quad & 15
            if whole or seen < machine.faint[level]:
                needs |= 1 << quad
                if queues.count[r, quad] == queues.visit.shape[2]:
                    return False
        if needs:
            state.touched[r, block] = visit >= 0
        if not one.gives[-1]:
            state.level[r, block] = max(state.level[r, block], least)
        for quad in range(QUADS):
            if needs >> quad & 1:
                at = (queues.head[r, quad] + queues.count[r, quad]) % queues.visit.shape[2]
                queues.visit[r, quad, at], queues.block[r, quad, at] = visit, block
                queues.came[r, quad, at] = cycle
                queues.count[r, quad] += 1
    for stage in range(STAGES - 1, 0, -1):
        one.visits[stage] = one.visits[stage - 1]
        one.blocks[stage] = one.blocks[stage - 1]
        one.gives[stage] = one.gives[stage - 1]
    one.visits[0] = NOTHING
    return True


@njit(cache=True)
def _issue(cycle, r, found, work, machine, queues, state, one):
    """Issue a rasterizer's next block; return 1 if its group ends."""
    busy = cycle <= one.last + RESULT_CYCLES or queues.count[r].any()
    busy |= (one.visits != NOTHING).any()
    if not one.started:
        if one.group + 1 < len(work[2]) and not busy:
            one.started, one.group = True, one.group + 1
            state.now[r] = state.before[r] = work[4][one.group, r]
            state.since[r] = 0
            for block in range(len(state.level[r])):
                state.level[r, block] = state.now[r, block].min()
        return 0
    at, issued, end = one.head % queues.pair.shape[1], False, False
    if queues.pairs[r] and queues.pair_came[r, at] + QUEUE_LATENCY <= cycle:
        end = queues.pair[r, at] == END
        if not end:
            issued = _visit(r, at, found, machine, queues, state, one)
    if one.next < len(machine.order):
        block = machine.order[one.next]
        if not state.stale[r, block]:
            one.next += 1
        elif not issued:
            _enter(r, block, OUTPUT, state, one)
            one.next += 1
    elif end and not busy:
        one.head, one.started, one.next = one.head + 1, False, 0
        queues.pairs[r] -= 1
        state.stale[r] = True
        return 1
    return 0


@njit(cache=True)
def _enter(r, block, visit, state, one):
    one.visits[0], one.blocks[0] = visit, block
    one.gives[0] = state.stale[r, block]
    state.stale[r, block] = False


@njit(cache=True)
def _visit(r, at, found, machine, queues, state, one):
    """Issue the present pair's next block; return whether there was one."""
    pair, tile, own = queues.pair[r, at], queues.tile[r, at], machine.own[r]
    marks, chosen, more = found.marks[pair], -1, False
    for k in range(len(own)):
        mark = marks >> MARK_BITS * own[k] & 7
        if mark > state.level[r, tile * len(own) + k] and not one.done >> k & 1:
            if chosen < 0:
                chosen = k
            else:
                more = True
    if chosen >= 0:
        visit = found.first[pair]
        for block in range(own[chosen]):
            visit += (marks >> MARK_BITS * block & 7) != 0
        _enter(r, tile * len(own) + chosen, visit, state, one)
        one.done |= 1 << chosen
    if not more:
        one.head, one.done = one.head + 1, 0
        queues.pairs[r] -= 1
    return chosen >= 0


@njit(cache=True)
def _deal(cycle, found, machine, queues, state, feeders):
    """Deal a pair to its rasterizers; return whether all have taken it."""
    pair, tile, all_took = state.pipe[-1], state.pipe_tile[-1], True
    if pair == NOTHING:
        return True
    for r in range(len(feeders)):
        one = feeders[r]
        if one.taken:
            continue
        reached, blocks = pair == END, len(machine.own[r])
        if pair != END:
            known = one.started and one.group == state.at[3]
            for k in range(blocks):
                mark = found.marks[pair] >> MARK_BITS * machine.own[r, k] & 7
                reached |= mark > (state.level[r, tile * blocks + k] if known else 0)
        if not reached:
            continue
        if queues.pairs[r] == queues.pair.shape[1]:
            all_took = False
            continue
        at = (one.head + queues.pairs[r]) % queues.pair.shape[1]
        queues.pair[r, at], queues.tile[r, at], queues.pair_came[r, at] = pair, tile, cycle
        queues.pairs[r] += 1
        one.taken = True
    if all_took:
        feeders["taken"][:] = False
        state.at[3] += pair == END
    return all_took


@njit(cache=True)
def _admit(work, machine, state, feeders):
    """Take the next splat, or drop it if none of its tiles is live."""
    mask, _, start, end, _ = work
    group, entry = state.at[5], state.at[4]
    if group == len(start) or state.waiting[1] == len(state.splats):
        return
    ends = entry == end[group]
    if ends or not _known(group, feeders) or _live(mask[entry], machine, state):
        at = (state.waiting[0] + state.waiting[1]) % len(state.splats)
        state.splats[at] = END if ends else entry
        state.waiting[1] += 1
    state.at[4] += 1
    if ends:
        state.at[5] = group + 1
        state.at[4] = start[group + 1] if group + 1 < len(start) else 0


@njit(cache=True)
def _known(group, feeders):
    """Return whether all rasterizers are at a group."""
    known = True
    for one in feeders:
        known &= one.started and one.group == group
    return known


@njit(cache=True)
def _live(mask, machine, state):
    """Return the live tiles of a mask."""
    live, blocks = 0, machine.own.shape[1]
    for tile in range(machine.tiles):
        of = state.level[:, tile * blocks : (tile + 1) * blocks]
        if mask >> tile & 1 and (of < machine.ended).any():
            live |= 1 << tile
    return live


@njit(cache=True)
def _expand(work, machine, state, feeders):
    """Issue the next pair of a splat and a live tile."""
    state.pipe[1:] = state.pipe[:-1].copy()
    state.pipe_tile[1:] = state.pipe_tile[:-1].copy()
    state.pipe[0] = NOTHING
    if state.waiting[1] == 0:
        return
    entry = state.splats[state.waiting[0]]
    if entry == END:
        state.pipe[0], state.at[2] = END, state.at[2] + 1
    else:
        mask = work[0][entry]
        left = mask if not _known(state.at[2], feeders) else _live(mask, machine, state)
        left &= ~state.at[1]
        if left:
            lowest = left & -left
            pair = work[1][entry]
            for tile in range(machine.tiles):
                if lowest >> tile & 1:
                    state.pipe[0], state.pipe_tile[0] = pair, tile
                pair += mask >> tile & 1
            state.at[1] |= lowest
            if left != lowest:
                return
    state.at[1] = 0
    state.waiting[0] = (state.waiting[0] + 1) % len(state.splats)
    state.waiting[1] -= 1
