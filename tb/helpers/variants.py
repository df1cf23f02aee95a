"""Planted faults in a simulated component, each of which the runs must detect."""

from collections.abc import Callable, Mapping
from functools import cache

import pytest
from amaranth.lib import wiring

from splatcore.sim.rtl.streams import Simulation
from tb.helpers.parts import Variants


def faults_are_found(
    make: Callable[[], wiring.Component],
    faults: Mapping[str, tuple],
    check: Callable[[Simulation, int], None],
) -> Callable:
    """Make a test function: the runs must pass without a fault and fail with each fault.

    faults: for `Variants`, by name
    check: runs a simulation of the variants with a number for the port `fault` (0: no fault); an
        assertion fails if it detects the fault
    """

    @cache
    def variants() -> Simulation:
        return Simulation(Variants(make, faults.values()))

    @pytest.mark.slow
    @pytest.mark.parametrize("fault", [None, *faults])
    def test(fault):
        if fault is None:
            check(variants(), 0)
        else:
            with pytest.raises(AssertionError):
                check(variants(), 1 + list(faults).index(fault))

    return test
