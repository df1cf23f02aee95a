"""Runs a component without streams on arrays of inputs, one element a cycle: arithmetic."""

import numpy as np
from amaranth.lib import wiring

from splatcore.sim.rtl.streams import Ports, Simulation


def input_widths(component: wiring.Component) -> dict[str, int]:
    """Bits of a component's inputs by their Verilog names."""
    return Ports.of(component).driven


def run(component: wiring.Component, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs [N] of a component for inputs [N], all as unsigned codes.

    In cycle n the inputs' elements n are applied, then outputs are sampled, then the clock rises:
    a component of latency L answers input n in sample n + L. All inputs must be given (a number
    stands for a constant array); no port may have more than 64 bits.
    """
    count = max(np.size(array) for array in inputs.values())
    result = Simulation(component, Ports.of(component).out).run({}, constants=inputs)
    return {name: values[:count] for name, values in result.samples.items()}
