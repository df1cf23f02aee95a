"""Exhaustive search of the first cycles of the merge of two runs; each planted fault is found."""

import pytest

from splatcore.hdl.sorting.merge import Merge
from splatcore.sim.rtl.formal import ProofError, cover, search
from tb.formal.merge import Merged
from tb.planted.fault import each, plant

DEPTH = 14  # cycles; takes half a minute, two more cycles take more than twice as long
COVER_DEPTH = 20  # cycles within which two full runs can be merged, or a merge can follow another


@pytest.mark.slow
@pytest.mark.parametrize("depth", [DEPTH - 2, pytest.param(DEPTH, marks=pytest.mark.verify)])
def test_merge_of_two_runs(depth):
    search(Merged(), depth)


@pytest.mark.slow
def test_merge_comes_to_its_end():
    cover(Merged(), COVER_DEPTH)


FAULTS = {
    "not stable": ("_compare", "< Cat(first.key, first.gone)", "<= Cat(first.key, first.gone)"),
    "a run at its end stays": ("_compare", "leaf.gone.eq(~self.live[way])", "leaf.gone.eq(0)"),
    "read before it is written": ("_fetch", "pointer != self.written[way]", "1"),
    "an entry is overwritten": ("_fetch", "~fetching & ~self.waits & left", "~fetching & left"),
    "the one behind is forgotten": ("_advance", "Mux(waits, behind, self.found)", "self.found"),
    "given without room": ("elaborate", "second & self.room", "second"),
    "given without a head": ("elaborate", "(~self.live | self.present).all()", "1"),
    "nothing is read": ("_fetch", "asked.eq(first)", "asked.eq(0)"),
    "a stop leaves heads": ("elaborate", "(self.live, self.present, ", "(self.live, "),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, Merge, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Merged(), DEPTH)
