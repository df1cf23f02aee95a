"""Proof of the list writer: pages, links, each entry in its slot, once; planted faults break it."""

import pytest

from splatcore.hdl.binning.list_writer import ListWriter
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.list_writer import SHAPES, Watched, Written, small
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

COVER_DEPTH = 16  # cycles within which a list of two pages can be written, and a page be missing
FAULT_DEPTH = 12  # cycles within which every fault below shows


@pytest.mark.parametrize("shape", SHAPES)
def test_writer_is_proved(shape):
    prove(Written(Watched(small(shape))))


def test_lists_come_to_their_ends():
    cover(Written(Watched(small("page4_burst2"))), COVER_DEPTH)


FAULTS = {
    "two lists have a page": ("_handle", "~flushing & turn)", "~flushing & fresh)"),
    "a page beyond the last": ("_handle", "needed < self.pages", "needed <= self.pages"),
    "the last page is not used": ("_handle", "needed < self.pages", "needed + 1 < self.pages"),
    "a page where the one before was": ("_handle", "(turn, inside,", "(fresh, inside,"),
    "a missing page is not reported": ("_handle", "m.If(~inside)", "m.If(0)"),
    "a link to its own page": ("_handle", "page_full, self.needed", "page_full, row.page"),
    "a link takes an entry's slot": ("_handle", "(turn, 1,", "(turn, 2,"),
    "a first entry in a wrong slot": ("_handle", "Mux(turn, 0, offset)", "offset"),
    "a burst twice": ("_handle", "written & ~had_burst", "written"),
    "a list twice": ("_handle", "flushing & ~had_group", "flushing"),
    "an entry behind a list": ("_handle", "Mux(flushing, 0, final)", "final"),
    "a row of the frame before": ("_handle", "Mux(self.taking, Val", "Mux(1, Val"),
    "a stale row": ("_present", "take & through & (held", "0 & (held"),
    "a stale entry": ("_present", "same & (slot == k)", "0"),
    "a row from before the reset": ("elaborate", "self.count - 1", "self.count - 2"),
    "flushed with an entry inside": ("elaborate", "free & ~self.i.valid", "free"),
}


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, ListWriter, *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Written(Watched(small("page4_burst2", groups=2))), FAULT_DEPTH)
