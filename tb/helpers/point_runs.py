"""Stages 0 and 1 in simulation, bit for bit against the golden model."""

from functools import cache

import numpy as np

from splatcore.hdl.points.points import COUNTED
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.config import Config
from splatcore.spec.counters import COUNTER_BITS
from tb.helpers.point_rows import PointRows
from tb.helpers.stage_cases import STAGES, case, settled_outputs


@cache
def simulation(stage: str, config: Config) -> Simulation:
    """A stage, compiled."""
    return Simulation(STAGES[stage](config))


def check(stage: str, frame: PointRows, stall: float, seed: int = 0):
    """A stage's outputs against the twins', every bit, and the counters."""
    what = case(stage, frame)
    result = simulation(stage, frame.config).run(
        what.inputs, constants=what.constants, expected=what.counts,
        first=what.first, stall=stall, seed=seed
    )  # fmt: skip
    assert result.finished, f"{stage}: {result.stopped}"
    for port, found in settled_outputs(stage, frame.config, result.outputs).items():
        expected = what.expected[port]
        assert len(found) == len(expected), f"{stage}.{port}: {len(found)}, not {len(expected)}"
        wrong = np.flatnonzero((found != expected).any(axis=1))
        assert not len(wrong), f"{stage}.{port}: {len(wrong)} differ, first {wrong[0]}"
    if stage == "points":
        counted = dict(zip(COUNTED, split(result.ports["counters"]), strict=True))
        assert {name: counted[name] for name in frame.counts} == frame.counts
    return result


def split(counters: int) -> list[int]:
    """Counters, each of a port's 32 bits."""
    return [counters >> k * COUNTER_BITS & (1 << COUNTER_BITS) - 1 for k in range(len(COUNTED))]
