"""The source texts that planted faults replace exist; most of these faults run only in
`make verify`."""

import pytest

from tb.formal.proof import proofs
from tb.planted.fault import planted

PROOFS = proofs()


def test_proofs_are_found():
    assert len(PROOFS) >= 12 and all(proof.faults for proof in PROOFS.values())


@pytest.mark.parametrize("proof", PROOFS)
def test_every_fault_has_its_place(proof):
    for part, method, old, new in PROOFS[proof].faults.values():
        planted(getattr(part, method), old, new)


def test_a_place_that_is_gone_is_found():
    part, method, _, new = PROOFS["cascade"].faults["a run too long"]
    with pytest.raises(AssertionError):
        planted(getattr(part, method), "self.size - 2", new)
