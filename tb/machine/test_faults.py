"""Whatever goes wrong: an error is told, nothing hangs, and the next frame is as good as ever."""

import pytest

from tb.helpers.fault_runs import KINDS, check_outcome, drawn, run_fault

FEW, RUNS = 10, 40
"""Random runs for each kind: more than 500 together, of which `make test` has the first few."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "seeds",
    [range(FEW), pytest.param(range(FEW, RUNS), marks=pytest.mark.verify)],
    ids=["few", "more"],
)
@pytest.mark.parametrize("kind", KINDS)
def test_fault(kind, seeds):
    for seed in seeds:
        fault = drawn(kind, seed)
        try:
            check_outcome(fault, run_fault(fault, seed))
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {fault}: {error}") from error
