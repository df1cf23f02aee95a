"""Proofs of credits, and of parts that push on credit, without a look at `ready`."""

import pytest

from splatcore.hdl.lib.credit import Credit
from splatcore.hdl.memory.fetch import Fetch
from splatcore.sim.rtl.formal import ProofError, cover, prove
from tb.formal.credit import Credited, Fetching, Given, credited
from tb.helpers.parts import SideBySide
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

COVER_DEPTH = 20  # cycles within which each part below can be full, and empty again


def given(most: int, step: int = 1) -> Given:
    return Given(Credit(most, "units taken", step=step))


PROOFS = {
    "one": lambda: given(1),
    "two": lambda: given(2),
    "five": lambda: given(5),  # not a power of two
    "several": lambda: given(8, step=4),
    "queue": lambda: credited(2, latency=1),
    "short": lambda: credited(3, latency=5),  # the datapath is never full
    "memory": lambda: credited(5, latency=2, memory=True),
    "fetch": Fetching,
}


def beside(*names: str) -> SideBySide:
    """Return proofs side by side, so that one solver run covers them all."""
    return SideBySide({name: PROOFS[name]() for name in names})


def test_credits():
    prove(beside(*PROOFS))


def test_credits_are_reached():
    """The assumptions can be met, and all units of a credit can be taken."""
    cover(beside(*PROOFS), COVER_DEPTH)


def test_unasked_credit_fails():
    """The hardware's own assertion takes part in proofs: free inputs ignore `room` and `any`."""
    with pytest.raises(ProofError, match="fails in step 1") as found:
        prove(Credit(2, "anything"))
    assert all("lib/holds.py" in line for line in found.value.lines)


NEXT = "count.eq(then)"
ENTERS, LEAVES = "comes.eq(passes(self.i))", "goes.eq(passes(self.o))"

FAULTS = {
    "one too many": ("five", Credit, "count != self.most", "count <= self.most"),
    "one too few": ("five", Credit, "count != self.most", "count < self.most - 1"),
    "empty too early": ("two", Credit, "count.any()", "count[1:].any()"),
    "returned units are not counted": ("one", Credit, NEXT, "count.eq(count + comes)"),
    "both at once is one more": ("five", Credit, NEXT, "count.eq(count + (comes | -goes))"),
    "one of several is counted": ("several", Credit, NEXT, "count.eq(count + comes.any() - goes)"),
    "it enters without room": ("queue", Credited, "eq(credit.room)", "eq(1)"),
    "not counted while in flight": ("memory", Credited, ENTERS, "comes.eq(queue.i.valid)"),
    "given back before it leaves": ("short", Credited, LEAVES, "goes.eq(queue.i.valid)"),
    "never given back": ("short", Credited, LEAVES, "goes.eq(0)"),
    "a whole burst in one place": ("fetch", Fetch, "used.count + beats <= self.depth", "used.room"),
    "a burst counts for one": ("fetch", Fetch, "Mux(asked, beats, 0)", "asked"),
    "room before a beat leaves": ("fetch", Fetch, LEAVES, "goes.eq(queue.i.valid)"),
    "no room for a whole burst": ("fetch", Fetch, "+ beats <= self.depth", "+ beats < self.burst"),
}
"""Per fault: the proof, the part, and a piece of its `elaborate` with its replacement."""


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    name, part, old, new = FAULTS[fault]
    plant(monkeypatch, part, "elaborate", old, new)
    with pytest.raises(ProofError, match="fails in step") as found:
        prove(PROOFS[name]())
    assert found.value.lines
