"""Proofs of components: each holds, its cases are reached, and each planted fault breaks it."""

import pytest

from splatcore.hdl.lib.credit import Credit
from splatcore.sim.rtl.formal import ProofError, prove
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
