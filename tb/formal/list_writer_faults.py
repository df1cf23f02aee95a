"""The proof of the list writer, and planted faults that break it."""

from splatcore.hdl.binning.list_writer import ListWriter
from tb.formal.list_writer import SHAPES, Watched, Written, small
from tb.formal.proof import Part, Proof
from tb.planted.fault import planted_in

COVER_DEPTH = 16  # cycles within which a list of two pages can be written, and a page be missing
FAULT_DEPTH = 12  # cycles within which every fault below shows

FAULTS = planted_in(
    ListWriter,
    _handle={
        "two lists have a page": ("~flushing & turn)", "~flushing & fresh)"),
        "a page beyond the last": ("needed < self.pages", "needed <= self.pages"),
        "the last page is not used": ("needed < self.pages", "needed + 1 < self.pages"),
        "a page where the one before was": ("(turn, inside,", "(fresh, inside,"),
        "a missing page is not reported": ("m.If(~inside)", "m.If(0)"),
        "a link to its own page": ("page_full, self.needed", "page_full, row.page"),
        "a link takes an entry's slot": ("(turn, 1,", "(turn, 2,"),
        "a first entry in a wrong slot": ("Mux(turn, 0, offset)", "offset"),
        "a burst twice": ("written & ~had_burst", "written"),
        "a list twice": ("flushing & ~had_group", "flushing"),
        "an entry behind a list": ("Mux(flushing, 0, final)", "final"),
        "a row of the frame before": ("Mux(self.taking, Val", "Mux(1, Val"),
    },
    _present={
        "a stale row": ("take & through & (held", "0 & (held"),
        "a stale entry": ("same & (slot == k)", "0"),
    },
    elaborate={
        "a row from before the reset": ("self.count - 1", "self.count - 2"),
        "flushed with an entry inside": ("free & ~self.i.valid", "free"),
    },
)


def part(*shape, **about) -> Part:
    return Part(lambda: Written(Watched(small(*shape))), **about)


PROOF = Proof(
    {shape: part(shape, cover=None if k else COVER_DEPTH) for k, shape in enumerate(SHAPES)},
    FAULTS,
    {"": part("page4_burst2", 2, search=FAULT_DEPTH)},
)
