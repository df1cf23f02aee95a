"""Runs of compiled components: compare rows of their streams, read counters."""

import shutil
from collections.abc import Callable, Hashable, Iterable
from functools import cache

import numpy as np
import pytest

from splatcore.sim.rtl.streams import Result, Simulation
from splatcore.spec.counters import COUNTER_BITS

Rows = dict[str, np.ndarray]

needs_icarus = pytest.mark.skipif(
    not shutil.which("iverilog"), reason="needs Icarus: apt-get install iverilog"
)


@cache
def compiled(make: Callable, *arguments: Hashable, samples: tuple[str, ...] = ()) -> Simulation:
    """Make a component from these arguments and compile it, once per process."""
    return Simulation(make(*arguments), samples)


def check_run(
    simulation: Simulation, inputs: Rows, expected: Rows, label="", settled=dict, **options
) -> Result:
    """Run a component and check that its output rows are exactly the expected ones.

    label: prefix of a stream's name in messages
    settled: function of the output rows that removes bits that do not matter
    options: of `Simulation.run`
    """
    counts = {port: len(rows) for port, rows in expected.items()}
    result = simulation.run(inputs, expected=counts, **options)
    assert result.finished, f"{label}{result.stopped}"
    outputs = settled(result.outputs)
    for port, rows in expected.items():
        found = outputs[port]
        assert len(found) == len(rows), f"{label}{port}: {len(found)} rows, not {len(rows)}"
        wrong = np.flatnonzero((found != rows).any(axis=1))
        assert not len(wrong), f"{label}{port}: {len(wrong)} differ, first {wrong[0]}"
    return result


def counters(names: Iterable[str], bits: int) -> dict[str, int]:
    """Split the value of a port into counters by name."""
    mask = (1 << COUNTER_BITS) - 1
    return {name: bits >> k * COUNTER_BITS & mask for k, name in enumerate(names)}
