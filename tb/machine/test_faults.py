"""Injected faults: each is reported, nothing hangs, and no other frame is disturbed."""

import pytest

from splatcore.sim.soak.fault_kinds import KINDS, PAIR_KINDS, check_outcome, drawn, hand_over
from splatcore.sim.soak.fault_runs import B, Fault, golden, run_fault
from splatcore.spec.config import DEFAULT, TINY
from splatcore.spec.registers import ErrorCode

SEEDS = {"first": range(3), "few": range(3, 6), "more": range(6, 40)}
"""Seeds of random runs for each kind. The first ones judge planted faults."""


def check(config, faults, seed, pair):
    for fault in faults:
        try:
            check_outcome(config, fault, run_fault(config, fault, seed, pair), pair)
        except AssertionError as error:
            raise AssertionError(f"seed {seed}: {fault}: {error}") from error


def check_drawn(config, kind, seeds, pair):
    for seed in seeds:
        check(config, [drawn(config, kind, seed, pair)], seed, pair)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", ["first", "few", pytest.param("more", marks=pytest.mark.verify)])
@pytest.mark.parametrize("kind", KINDS)
def test_alone(kind, seeds):
    check_drawn(TINY, kind, SEEDS[seeds], pair=False)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", ["first", "few", pytest.param("more", marks=pytest.mark.verify)])
@pytest.mark.parametrize("kind", PAIR_KINDS)
def test_with_a_frame_in_flight(kind, seeds):
    check_drawn(TINY, kind, SEEDS[seeds], pair=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.verify) for k in (1, 2))])
@pytest.mark.parametrize("pair", [False, True])
def test_every_cycle_of_a_hand_over(seed, pair):
    check(TINY, hand_over(TINY, seed, pair), seed, pair)


@pytest.mark.slow
@pytest.mark.parametrize("pair", [False, True])
def test_exactly_enough(pair):
    """Exactly the list pages and features that a frame needs are enough; one fewer is not."""
    binned = golden(TINY, B).binned
    needed = {"LISTS_PAGES": binned.lists.needed, "FEATURES_MAX": len(binned.kept)}
    enough = Fault(ErrorCode.NONE, values=needed, survives=True, reported=False)
    check(TINY, [enough], 0, pair)
    for name, code in (("LISTS_PAGES", ErrorCode.PAGES), ("FEATURES_MAX", ErrorCode.FEATURES)):
        check(TINY, [Fault(code, values={name: needed[name] - 1})], 0, pair)


@pytest.mark.slow
@pytest.mark.parametrize("kind", PAIR_KINDS)
def test_at_full_size(kind):
    """The full HD machine, each kind once."""
    check_drawn(DEFAULT, kind, range(1), pair=True)
