"""Stage 3 in simulation."""

import functools

from splatcore.hdl.raster.prepare import Prepare
from splatcore.sim.rtl.streams import Simulation
from tb.helpers.raster_rows import Watched


@functools.cache
def simulation(config) -> Simulation:
    return Simulation(Watched(config), samples=("live", "full", "empty"))


@functools.cache
def prepare_simulation(config) -> Simulation:
    return Simulation(Prepare(config))
