"""Proof of a release's effect on the batches in a cascade; each planted fault breaks it."""

import pytest

from splatcore.hdl.sorting.sorter import Sorter
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.sorter import Released, sorter
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

DEPTH = 10  # cycles within which batches can be dropped, and every fault below shows


def test_releases_are_proved():
    prove(Released(sorter()))
    cover(Released(sorter()), DEPTH)


FAULTS = {
    "nothing is dropped": ("drops.eq(inside.count - inside.goes)", "drops.eq(0)"),
    "all is dropped from then on": ("drops.eq(drops - 1)", "drops.eq(drops)"),
    "a batch is dropped too few": ("inside.count - inside.goes)\n", "inside.count - 1)\n"),
    "the batch that begins is dropped": (
        "drops.eq(inside.count - inside.goes)",
        "drops.eq(inside.count + inside.comes)",
    ),
    "the other half's is dropped": ("dropped[1], dropped[0]", "*dropped"),
    "a batch goes to the first's": ("eq(i.payload.entry.last)", "eq(0)"),
    "a dropped one waits": ("o.ready | stale", "o.ready"),
    "a dropped one is offered": ("part.o.valid & ~stale", "part.o.valid"),
}


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, Sorter, "_batches", *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Released(sorter()), DEPTH)
