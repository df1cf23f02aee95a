"""Performance counters: every event counts once, across the carry; at the end counters stay."""

import numpy as np
import pytest

from splatcore.hdl.lib.counters import SPARE, Counters
from splatcore.sim.rtl.streams import Simulation

BITS = 12  # few, so that the end is reached

pytestmark = pytest.mark.slow


def counts(event: np.ndarray, clear: np.ndarray) -> np.ndarray:
    """Return the values of both counters in every cycle, [cycles, 2]."""
    run = Simulation(Counters(("one", "other"), BITS), samples=("value",)).run(
        {}, constants={"event": event, "clear": clear}, cycles_max=len(event) + 8
    )
    value = run.samples["value"].astype(np.int64)
    return np.stack([value & ((1 << BITS) - 1), value >> BITS], axis=1)


def test_every_event_is_counted_once():
    rng = np.random.default_rng(1)
    cycles = (1 << BITS) - 200
    event = rng.integers(0, 4, cycles).astype(np.uint64)
    event[-1] = 0  # inputs keep their last value
    found = counts(event, np.zeros(cycles, np.uint64))
    for bit in range(2):
        assert found[-1, bit] == int((event >> np.uint64(bit) & np.uint64(1)).sum())
        steps = np.diff(found[:, bit])
        assert steps.min() == 0 and steps.max() == 1  # no cycle shows a count without its carry


def test_end():
    cycles = (1 << BITS) + 500
    found = counts(np.full(cycles, 3, np.uint64), np.zeros(cycles, np.uint64))
    assert (np.diff(found, axis=0) >= 0).all()
    assert (1 << BITS) - (1 << SPARE) <= found[-1].min() <= found[-1].max() < 1 << BITS


def test_clear():
    event, clear = np.full(40, 3, np.uint64), np.zeros(40, np.uint64)
    event[20:], clear[20] = 0, 1
    found = counts(event, clear)
    assert found[19].min() > 10 and found[22:].max() == 0
