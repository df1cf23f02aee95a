"""Cycles of each stage and of both halves, from a machine's sizes and the golden model's counts.

A stage's cycles assume inputs that are always valid and outputs that are always ready: the sum over
its chunks, points, splats, entries or blocks. In a half, stages wait for each other
(`sim.cycles.preprocessing`, `sim.cycles.rendering`).
"""

from dataclasses import asdict, dataclass

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.sim.cycles.preprocessing import (
    bin_costs,
    chunk_interval,
    level_costs,
    preprocessing_cycles,
)
from splatcore.sim.cycles.raster import raster_cycles
from splatcore.sim.cycles.rendering import rendering_cycles
from splatcore.sim.cycles.sort import cycles as sort_cycles
from splatcore.sim.machine.script import LPDDR4, Timing
from splatcore.spec.config import Config
from splatcore.spec.group import group_grid
from splatcore.spec.microprogram import culling, program, projection
from splatcore.spec.schedule import schedule
from splatcore.spec.stages import HALVES


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
    preprocessing: int  # stages 0 and 1, binning and their memory side
    rendering: int  # stages 2 and 3 and their memory side

    @property
    def frame(self) -> int:
        """Cycles per frame: the slower half, as both work on consecutive frames at once."""
        return max(self.preprocessing, self.rendering)

    @property
    def by_name(self) -> dict[str, int]:
        """Cycles by the names that results use: stages, halves and the frame."""
        return asdict(self) | {"frame": self.frame}

    @property
    def binding(self) -> tuple[str, str]:
        """The slower half, and its slowest stage."""
        half = "preprocessing" if self.preprocessing >= self.rendering else "rendering"
        return half, max(HALVES[half], key=self.by_name.get)


def frame_cycles(config: Config, frame: Frame, timing: Timing = LPDDR4) -> Cycles:
    """Cycles of a frame of the golden model. timing: of memory; only its latency is used."""
    points = frame.points
    raster = raster_cycles(config, frame)
    headers = np.count_nonzero(points.drawn) * chunk_interval(config)
    return Cycles(
        chunk=int(headers + level_costs(config, points, timing.latency).sum()),
        cull=len(points.step) * schedule(config, culling(config.depth_interval)).interval,
        place=int(np.count_nonzero(points.step)) * schedule(config, program("place")).interval,
        project=len(points.inside) * schedule(config, projection(config)).interval,
        bin=int(bin_costs(frame).sum()) + len(frame.binned.lists.count),  # and one per list's end
        sort=sort_cycles(config, np.diff(frame.start)),
        raster=raster,
        preprocessing=preprocessing_cycles(config, frame, timing.latency),
        rendering=rendering_cycles(config, frame, timing.latency, raster),
    )


def group_cycles(config: Config, frame: Frame, timing: Timing = LPDDR4) -> np.ndarray:
    """Cycles [rows, columns] of the second half per group: from the previous group's last pixel to
    its own last pixel; 0 for groups without a splat."""
    height, width = frame.pixels.shape[:2]
    ends = np.zeros(len(frame.start) - 1)
    rendering_cycles(config, frame, timing.latency, raster_cycles(config, frame), ends)
    ends[ends > 0] = np.diff(ends[ends > 0], prepend=0)
    return ends.reshape(group_grid(config, width, height))
