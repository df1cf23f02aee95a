"""Proof of a cascade's merges: stable, whole, pair after pair; each planted fault breaks it."""

import pytest

from splatcore.hdl.sorting.cascade import Pair
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.cascade import MERGES, Merged, pair
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

COVER_DEPTH = 10  # cycles within which two full runs can be merged
FAULT_DEPTH = 10  # cycles within which every fault below shows


@pytest.mark.parametrize("merge", MERGES)
def test_merge_is_proved(merge):
    prove(Merged(pair(*MERGES[merge])))


def test_pairs_come_to_their_ends():
    cover(Merged(pair(*MERGES["2"])), COVER_DEPTH)


FAULTS = {
    "a later entry wins a tie": ("_merge", "entry.key < first", "entry.key <= first"),
    "a run alone waits": ("_merge", "& ~pair.payload", ""),
    "a run too long": ("_push", "self.size - 1", "self.size"),
    "the next batch's runs are paired": ("_push", "~turn & ~i.payload.last", "~turn"),
    "a pair is not over": ("_merge", "second.payload.last & ~left[0]", "second.payload.last"),
    "a batch's end is lost": ("_merge", "pair.payload | Mux(", "Mux("),
    "the second run's index": ("_merge", "entry.index, chosen", "entry.index, 0"),
    "the second run's end is forgotten": ("_merge", "eq(second.payload.entry.last)", "eq(0)"),
    "a head that has not come": ("_merge", "(~left[1] | second.valid)", "1"),
    "a run for the other queue": ("_push", "Mux(turn, self", "Mux(~turn, self"),
}  # fmt: skip


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, Pair, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Merged(pair(*MERGES["2"])), FAULT_DEPTH)
