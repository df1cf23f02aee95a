"""Exhaustive search of the list reader's first cycles; each planted fault is found."""

import pytest

from splatcore.hdl.raster.list_reader import ListReader
from splatcore.sim.rtl.formal import ProofError, cover, search
from tb.formal.list_reader import Read
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

DEPTH = 12  # cycles within which a list of two pages can be read; one more doubles the run time


def test_lists_are_read():
    search(Read(), DEPTH)
    cover(Read(), DEPTH)


FAULTS = {
    "a link is taken for an entry": (
        "goes_on, self.config.page - 1,",
        "goes_on, self.config.page,",
    ),
    "a full page has no link": ("left >= self.config.page", "left > self.config.page"),
    "a link that has not come": ("ahead.goes & (ahead.count == 1)", "ahead.goes"),
    "a link in the wrong slot": ("beat[-ENTRY_BITS:]", "beat[:ENTRY_BITS]"),
    "a page at a wrong address": ("self.lists_at + page * beats", "self.lists_at + page"),
    "a beat too few": ("(left + slots_a_beat - 1)", "left"),
}


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    plant(monkeypatch, ListReader, "_pages", *FAULTS[fault])
    with pytest.raises(ProofError, match="fails in step"):
        search(Read(), DEPTH)
