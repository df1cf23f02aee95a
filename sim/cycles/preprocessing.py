"""Cycles of the whole first half: reading the model, stages 0 and 1, and binning.

Skipped chunks and points behind the camera leave stage 1 idle; splats with many tiles stall it. So
points and splats are traced one by one through the queues between the stages.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from splatcore.golden.pipeline import Frame
from splatcore.golden.points import Points
from splatcore.hdl.points.model_reader import BEATS_WAITING
from splatcore.hdl.points.points import CHUNKS_WAITING
from splatcore.hdl.points.project import SPARE
from splatcore.spec.axi import BEAT, BURST_BEATS
from splatcore.spec.config import Config
from splatcore.spec.levels import LEVEL
from splatcore.spec.memory import CHUNK, CHUNK_HEADER
from splatcore.spec.microprogram import culling, program, projection
from splatcore.spec.schedule import schedule

LEVEL_BEATS = (CHUNK_HEADER.size + LEVEL.size) // BEAT  # of a header with its record
SET_UP = 3  # minimum cycles per splat in binning

# Cycles from registers and states, without memory latency.
HEADER = 10  # from keeping a chunk to its first point
ATTRIBUTES = 12  # from placing a point to its attributes
SPLAT = 5  # from the end of the array to binning
AROUND = 17  # of a header, besides its array: ends are converted, then it is judged
INSIDE = 4  # points that an array of stage 0 or 1 buffers
LAST_BURST = 2  # cycles per list's end, in addition to its entry in the table
BEGIN = 150  # from a frame's start to its first chunk, plus from its last entry to its end


def chunk_interval(config: Config) -> int:
    """Cycles per chunk header; its array processes one chunk at a time."""
    return schedule(config, program("chunk")).length + AROUND


def level_costs(config: Config, points: Points, latency: int) -> np.ndarray:
    """Cycles [C] per chunk in choosing levels, without those of headers that are drawn: a group is
    tested like a header; other records and headers are read, a beat every other cycle, and dropped.
    Behind a group that is drawn or out of view, these are the ones on their way when the reader
    turns.
    Zeros without levels. latency: memory cycles from a request to its first beat"""
    tested, drawn = points.tested, points.drawn
    if not tested.any():
        return np.zeros(len(drawn))
    item = 2 * CHUNK_HEADER.size // BEAT
    costs = np.where(tested, chunk_interval(config), item) + np.where(drawn, 0, item)
    number, below = np.arange(len(drawn)), ~(drawn | tested)
    behind = number - np.maximum.accumulate(np.where(below, -1, number))  # place in a run, or 0
    turn = BEATS_WAITING // LEVEL_BEATS  # headers on their way
    costs[behind > turn] = 0
    return costs + (behind == turn + 1) * max(0, latency - 2 * BURST_BEATS)


def bin_costs(frame: Frame) -> np.ndarray:
    """Cycles [N] per splat in binning: the maximum of set-up, tile rows and entries."""
    longest = np.maximum(frame.binned.splat_rows, frame.binned.splat_entries)
    return np.maximum(longest, SET_UP)


def preprocessing_cycles(config: Config, frame: Frame, latency: int) -> int:
    """Cycles of a frame's first half. latency: memory cycles from a request to its first beat."""
    points, plan = frame.points, schedule(config, projection(config))
    chunks = np.where(points.read, CHUNK, 0)
    chunks[np.flatnonzero(chunks)[-1:]] -= chunks.sum() - len(points.step)  # a short last chunk
    levels, interval = level_costs(config, points, latency), chunk_interval(config)
    waits = np.diff(np.cumsum(levels)[points.drawn], prepend=0)
    cull, place = (schedule(config, p) for p in (culling(config.depth_interval), program("place")))
    parts = Parts(
        Part(interval, HEADER + latency),
        Part(cull.interval, cull.length),
        Part(place.interval, place.length + ATTRIBUTES + latency),
        Part(plan.interval, plan.length + SPLAT),
    )
    slots, queue = config.projection_slots, plan.length // plan.interval + 1 + SPARE
    drawn = chunks[points.drawn]
    end = pass_points(drawn, waits, points.step, bin_costs(frame), parts, slots, queue)
    begin = BEGIN + 3 * latency + config.codebook // BEAT
    count = frame.binned.lists.count
    end = max(end, levels.sum() + len(waits) * interval)
    return int(begin + end + len(count) + LAST_BURST * np.count_nonzero(count))


class Part(NamedTuple):
    """A part of stages 0 and 1: cycles from one item to the next, and through it."""

    interval: int
    length: int


class Parts(NamedTuple):
    """The parts of stages 0 and 1, named like their programs."""

    chunk: Part
    cull: Part
    place: Part
    project: Part


@njit(cache=True)
def pass_points(chunks, waits, kind, costs, parts, slots, queue):
    """Trace all points through stages 0 and 1; the cycle in which the last splat is binned.

    chunks: [C] points that are read per drawn chunk
    waits: [C] cycles of choosing levels from the drawn chunk before to this one; the same PE
    kind: [N] last step of each point: 0 culled, 1 outside the guard band, 2 projected, 3 a splat
    costs: [M] binning cycles per splat
    parts: `Parts`
    slots, queue: entries of the projection's slots and output queue
    """
    chunk, cull, place, project = parts
    header = culled = placed = entered = binned = 0.0
    through = np.zeros(CHUNKS_WAITING + 1)  # when the last chunks left culling
    cull_left, place_left = np.zeros(INSIDE), np.zeros(INSIDE)  # when points left
    released, gone = np.zeros(slots), np.zeros(queue)
    cost = 0
    point = read = front = inside = splats = 0
    for number, count in enumerate(chunks):
        header += waits[number] + chunk.interval
        if count == 0:
            continue
        header = max(header, through[read % len(through)])
        for k in range(count):
            culled = max(culled + cull.interval, header + chunk.length if k == 0 else 0)
            if kind[point] > 0:
                culled = max(culled, cull_left[front % INSIDE])
                placed = max(placed + place.interval, culled + cull.length)
                if kind[point] > 1:
                    placed = max(placed, place_left[inside % INSIDE])
                    pushed = max(placed + place.length, released[inside % slots])
                    entered = max(entered + project.interval, pushed, gone[splats % queue])
                    entered = (
                        np.ceil(entered / project.interval) * project.interval
                    )  # the array's round
                    place_left[inside % INSIDE] = pushed - place.length
                    released[inside % slots] = entered + project.length
                    inside += 1
                    if kind[point] > 2:
                        binned = max(binned + cost, entered + project.length)
                        cost = costs[splats]
                        gone[splats % queue] = binned - project.length
                        splats += 1
                cull_left[front % INSIDE] = placed - cull.length
                front += 1
            point += 1
        through[read % len(through)] = culled
        read += 1
    return max(binned + cost, culled + cull.length, header)
