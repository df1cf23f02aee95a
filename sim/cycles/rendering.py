"""Cycles of the whole second half: lists from memory, stage 2, stage 3 and pixels to memory.

Stages wait for each other: a job's runs are all formed before its first entry is given, a list that
does not fit on chip is dealt before its jobs are read, stage 3 holds stage 2 back, and a group's
pixels are written while the next one's are made. Groups without a splat are written whenever no
others can be.
"""

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.golden.sort import jobs
from splatcore.sim.cycles.raster import END, GIVEN, Raster
from splatcore.sim.cycles.sort import Timeline
from splatcore.spec.axi import port_bytes
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.raster import span_blocks, spans_meet
from splatcore.spec.work import PIXEL, page_bytes

MERGE_PACE = 2  # cycles from a merged entry to the next one

# Cycles as memory's side makes them, besides its latency.
FEATURE_LATENCY = 12  # from a merged entry to its splat's coming to stage 3
PAGE_LATENCY = 6  # from a page's last beat to the next one's request and back
GROUP_TURN = 1  # from a group to the next one, in writing
DEALT_TO_MEMORY = 2.65  # an entry that is dealt, as measured, with the port between
BEGIN = 40  # from a frame's start to its first entry, and from its last pixel to its end


def rendering_cycles(
    config: Config, frame: Frame, latency: int, ends: np.ndarray | None = None
) -> int:
    """Cycles of a frame's second half. latency: of memory, from a request to its first beat; ends
    [groups]: takes the cycle in which each group's last pixel has ended, where it has a splat."""
    stage = Raster(config, frame)

    def give(first: float, entries: int) -> float:
        return stage.entries(entries, first, MERGE_PACE, FEATURE_LATENCY + latency)

    # A page is asked for when the one before is there.
    beats = page_bytes(config) // port_bytes(config) + PAGE_LATENCY + latency
    pace = max(1.0, beats / (config.page - 1))
    timeline = Timeline(config, pace, latency, give, DEALT_TO_MEMORY)
    found = jobs(config, [keys for keys in frame.lists if len(keys)], again=True)
    counts, cycles = np.diff(frame.start), write_cycles(config, frame)
    empty = cycles[counts == 0].sum()  # cycles of groups without a splat that are yet to be written
    written = ended = 0.0  # when the groups before the last one were written; when that one ended
    last = 0.0  # cycles of its pixels

    def write(gone: float):
        """The last group's pixels are written. gone: when its last block was given out."""
        nonlocal written, empty
        begun = max(written, ended + GIVEN)
        done = max(begun + last, gone + GIVEN)
        stage.write(begun, done - begun)
        empty -= min(empty, done - written - last)
        written = done

    for number, (count, spans) in enumerate(zip(counts, cycles, strict=True)):
        if not count:  # it passes stages 2 and 3 by
            stage.number += 1
            continue
        timeline.group(next(found))
        write(stage.end())
        ended, last = stage.clock[END], spans
        if ends is not None:
            ends[number] = ended
    write(ended + stage.given)
    return int(written + empty) + BEGIN + 2 * latency


def write_cycles(config: Config, frame: Frame) -> np.ndarray:
    """Cycles [groups] in which their pixels are written: rows of a few blocks side by side."""
    height, width = frame.pixels.shape[:2]
    span, side = span_blocks(config), group_pixels(config)
    rows, columns = group_grid(config, width, height)
    high = np.minimum(height - np.arange(rows) * side, side)
    wide = np.minimum(width - np.arange(columns) * side, side)
    across, size = -(-wide // (span * BLOCK)), span * BLOCK * PIXEL
    pairs = across // 2 * spans_meet(config)
    beats = pairs * (2 * size // port_bytes(config))
    beats += (across - 2 * pairs) * -(-size // port_bytes(config))
    return ((-(-high // BLOCK) * BLOCK)[:, None] * beats[None] + GROUP_TURN).ravel()
