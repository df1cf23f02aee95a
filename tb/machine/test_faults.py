"""Whatever goes wrong: an error is told, nothing hangs, and the next frame is as good as ever."""

import pytest

from tb.helpers.fault_runs import KINDS, check_outcome, drawn, run_fault

SEEDS = {"first": range(3), "few": range(3, 10), "more": range(10, 40)}
"""Random runs for each kind: more than 500 together. The first ones judge planted faults."""


@pytest.mark.slow
@pytest.mark.parametrize("seeds", ["first", "few", pytest.param("more", marks=pytest.mark.verify)])
@pytest.mark.parametrize("kind", KINDS)
def test_fault(kind, seeds):
    for seed in SEEDS[seeds]:
        fault = drawn(kind, seed)
        try:
            check_outcome(fault, run_fault(fault, seed))
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {fault}: {error}") from error
