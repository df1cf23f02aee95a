"""Run a component without streams on arrays of inputs, one element per cycle: arithmetic."""

import numpy as np
from amaranth.lib import wiring

from splatcore.sim.rtl.streams import Ports, Simulation


def input_widths(component: wiring.Component) -> dict[str, int]:
    """Widths of a component's inputs by Verilog name."""
    return Ports.of(component).driven


def run(component: wiring.Component, inputs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs [N] of a component for inputs [N], all as unsigned codes.

    In cycle n elements n of the inputs are applied, then outputs are sampled, then the clock rises:
    with a latency of L, sample n + L is the result of input n. All inputs are required; a number
    stands for a constant array. No port may have more than 64 bits.
    """
    count = max(np.size(array) for array in inputs.values())
    result = Simulation(component, Ports.of(component).out).run({}, constants=inputs)
    return {name: values[:count] for name, values in result.samples.items()}
