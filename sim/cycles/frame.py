"""Cycles of each stage from a machine's sizes and the golden model's counts, without the RTL.

Each stage by itself, its inputs always valid and its outputs always taken: cycles of each chunk,
point, splat, entry and block are summed up. And both halves as wholes, in which stages wait for
each other (`sim.cycles.preprocessing`, `sim.cycles.rendering`).
"""

from dataclasses import asdict, dataclass

import numpy as np

from splatcore.golden.pipeline import Frame
from splatcore.sim.cycles.preprocessing import bin_costs, chunk_interval, preprocessing_cycles
from splatcore.sim.cycles.raster import raster_cycles
from splatcore.sim.cycles.rendering import rendering_cycles
from splatcore.sim.cycles.sort import cycles as sort_cycles
from splatcore.sim.machine.script import LPDDR4, Timing
from splatcore.spec.config import Config
from splatcore.spec.microprogram import culling, program, projection
from splatcore.spec.schedule import schedule


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
        """Both halves, at work at once on neighbouring frames."""
        return max(self.preprocessing, self.rendering)

    @property
    def by_name(self) -> dict[str, int]:
        """Stages, halves and the frame, as results have them."""
        return asdict(self) | {"frame": self.frame}


def frame_cycles(config: Config, frame: Frame, timing: Timing = LPDDR4) -> Cycles:
    """Cycles of a frame of the golden model. timing: of memory; its latency matters here."""
    points = frame.points
    return Cycles(
        chunk=len(points.read) * chunk_interval(config),
        cull=len(points.points) * schedule(config, culling(config.depth_interval)).interval,
        place=len(points.front) * schedule(config, program("place")).interval,
        project=len(points.inside) * schedule(config, projection(config)).interval,
        bin=int(bin_costs(frame).sum()) + len(frame.binned.lists.count),  # and all lists' ends
        sort=sort_cycles(config, np.diff(frame.start)),
        raster=raster_cycles(config, frame),
        preprocessing=preprocessing_cycles(config, frame, timing.latency),
        rendering=rendering_cycles(config, frame, timing.latency),
    )
