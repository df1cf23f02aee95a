"""Cycles of the whole second half: reading lists, stage 2, stage 3 and writing pixels.

Stages wait for each other: all runs of a job are formed before its first entry is output, a list
that does not fit on chip is dealt into buckets before its jobs are read, stage 3 stalls stage 2,
and a group's pixels are written while the next group is rasterized. Groups without a splat are
written when no other pixels are.
"""

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.golden.sort import jobs
from splatcore.sim.cycles.raster import WRITE_LATENCY, Raster, block_wide
from splatcore.sim.cycles.sort import Timeline
from splatcore.spec.axi import port_bytes
from splatcore.spec.config import Config
from splatcore.spec.convention import BLOCK
from splatcore.spec.group import group_grid, group_pixels
from splatcore.spec.raster import span_blocks, spans_meet
from splatcore.spec.work import PIXEL, page_bytes

MERGE_PACE = 2  # cycles per merged entry

# Cycles of the memory side, without memory latency.
FEATURE_LATENCY = 12  # from merging an entry to its splat's arrival at stage 3
PAGE_LATENCY = 6  # from a page's last beat to the next page's request and back
GROUP_TURN = 1  # between groups, in writing
DEALT_TO_MEMORY = 1.8  # per dealt entry, measured, memory port included
BEGIN = 40  # from a frame's start to its first entry, plus from its last pixel to its end


def rendering_cycles(
    config: Config, frame: Frame, latency: int, raster: int, ends: np.ndarray | None = None
) -> int:
    """Cycles of a frame's second half.

    latency: memory cycles from a request to its first beat
    raster: cycles of stage 3 alone (`raster_cycles`)
    ends: [groups] output: cycle of the last pixel of each group with a splat
    """
    wide, step = block_wide(config, frame, raster)
    stage = Raster(wide, frame, step)

    def rasterize(first: float, entries: int) -> float:
        return stage.entries(entries, first, MERGE_PACE, FEATURE_LATENCY + latency)

    # A page is requested when the previous page has arrived.
    beats = page_bytes(config) // port_bytes(config) + PAGE_LATENCY + latency
    pace = max(1.0, beats / (config.page - 1))
    timeline = Timeline(config, pace, latency, rasterize, DEALT_TO_MEMORY)
    found = jobs(config, [keys for keys in frame.lists if len(keys)], again=True)
    counts, cycles = np.diff(frame.start), write_cycles(config, frame)
    empty = cycles[counts == 0].sum()  # cycles to write the remaining groups without a splat
    written = ended = 0.0  # when all groups before the last were written; when the last one ended
    last = 0.0  # cycles to write its pixels

    def write(gone: float):
        """Write the last group's pixels. gone: when its last block was emitted."""
        nonlocal written, empty
        begun = max(written, ended + WRITE_LATENCY)
        done = max(begun + last, gone + WRITE_LATENCY)
        stage.write(begun, done - begun)
        empty -= min(empty, done - written - last)
        written = done

    for number, (count, spans) in enumerate(zip(counts, cycles, strict=True)):
        if not count:  # it bypasses stages 2 and 3
            stage.number += 1
            continue
        timeline.group(next(found))
        write(stage.end())
        ended, last = stage.clock["end"], spans
        if ends is not None:
            ends[number] = ended
    write(ended + stage.group_blocks)
    return int(written + empty) + BEGIN + 2 * latency


def write_cycles(config: Config, frame: Frame) -> np.ndarray:
    """Cycles [groups] to write each group's pixels, in rows of a few adjacent blocks."""
    height, width, pixel = frame.pixels.shape
    span, side = span_blocks(config), group_pixels(config)
    rows, columns = group_grid(config, width, height)
    high = np.minimum(height - np.arange(rows) * side, side)
    wide = np.minimum(width - np.arange(columns) * side, side)
    across, size = -(-wide // (span * BLOCK)), span * BLOCK * pixel
    pairs = across // 2 * (spans_meet(config) and pixel == PIXEL)
    beats = pairs * (2 * size // port_bytes(config))
    beats += (across - 2 * pairs) * -(-size // port_bytes(config))
    return ((-(-high // BLOCK) * BLOCK)[:, None] * beats[None] + GROUP_TURN).ravel()
