"""Planted faults in a component that is simulated, each of which runs must find."""

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
    """A test for a test file: runs pass without a fault and fail with each.

    faults: name → one of those of `Variants`. check: makes the runs on a simulation of the variants
    whose port `fault` has this number, 0 for none; an assertion fails if a fault is found.
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
