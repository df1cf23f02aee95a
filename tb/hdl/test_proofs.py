"""Proofs of components: each holds, its cases are reached, and each planted fault breaks it.
Proofs, searches and covers of `sim.rtl.formal` fail with the step and the line."""

from collections.abc import Callable

import pytest
from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.credit import Credit
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.proof import proofs
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

PROOFS = proofs()

PARTS = [
    pytest.param(name, part, marks=[pytest.mark.verify] * proof.parts[part].verify)
    for name, proof in PROOFS.items()
    for part in proof.parts
]
COVERED = [
    (name, part)
    for name, proof in PROOFS.items()
    for part in proof.parts
    if proof.parts[part].cover
]
FAULTS = [
    pytest.param(name, *one.values, marks=one.marks)
    for name, proof in PROOFS.items()
    for one in each(proof.faults)
]


@pytest.mark.parametrize("name, part", PARTS)
def test_proved(name, part):
    PROOFS[name].parts[part].holds()


@pytest.mark.parametrize("name, part", COVERED)
def test_reached(name, part):
    """The assumptions can be met, and no assertion holds for lack of cases."""
    PROOFS[name].parts[part].reached()


@pytest.mark.parametrize("name, fault", FAULTS)
def test_fault_is_found(name, fault, monkeypatch):
    proof = PROOFS[name]
    plant(monkeypatch, *proof.faults[fault])
    with pytest.raises(ProofError, match="fails in step") as found:
        proof.judge(fault).holds()
    assert found.value.step is not None and found.value.lines
    assert name != "stream" or all("formal/stream.py" in line for line in found.value.lines)


def test_unasked_credit_fails():
    """The hardware's own assertion takes part in proofs: free inputs ignore `room` and `any`."""
    with pytest.raises(ProofError, match="fails in step 1") as found:
        prove(Credit(2, "anything"))
    assert all("lib/holds.py" in line for line in found.value.lines)


class Counter(wiring.Component):
    """Counts from 0 to 5 and stays there; `check` makes a statement about its value."""

    def __init__(self, check: Callable):
        super().__init__({"i": In(1)})
        self.check = check

    def elaborate(self, platform) -> Module:
        m = Module()
        value = Signal(3)
        m.d.sync += value.eq(Mux(value == 5, 5, value + 1))
        m.d.comb += self.check(value)
        return m


def test_step():
    with pytest.raises(ProofError, match="fails in step 0") as found:
        prove(Counter(lambda value: Assert(value != 0)))
    assert found.value.step == 0
    search(Counter(lambda value: Assert(value != 5)), depth=5)
    for check in (prove, search):
        with pytest.raises(ProofError, match=r"fails in step 5: .*test_proofs.py:\d+$") as found:
            check(Counter(lambda value: Assert(value != 5)), depth=6)
        assert found.value.step == 5


def test_true_but_not_by_induction():
    """Before 7 comes 6, and before 6 only 5, which stays: induction needs one cycle more."""
    with pytest.raises(ProofError, match="does not follow by induction over 1 cycles") as found:
        prove(Counter(lambda value: Assert(value != 7)), depth=1)
    assert found.value.step is None and len(found.value.lines) == 1
    prove(Counter(lambda value: Assert(value != 7)), depth=2)


def test_cover():
    cover(Counter(lambda value: Cover(value == 5)), depth=6)
    with pytest.raises(ProofError, match=r"not reached in 5 cycles: .*test_proofs.py:\d+$"):
        cover(Counter(lambda value: Cover(value == 5)), depth=5)
    with pytest.raises(ProofError, match="not reached"):
        cover(Counter(lambda value: [Assume(value != 3), Cover(value == 5)]), depth=8)


@pytest.mark.parametrize("check", [prove, search, cover])
def test_nothing_to_check(check):
    with pytest.raises(ValueError, match="nothing to check"):
        check(Counter(lambda value: []), depth=1)
