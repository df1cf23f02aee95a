"""Setup, stage 3's third step: splats and tiles in, E around the tiles out.

No tie: it has no comparisons.
"""

from splatcore.hdl.raster.setup import Setup
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.parts import Handshake
from tb.helpers.raster_cases import Pairs, by_kind

SPLATS = 100


def component() -> Handshake:
    return Handshake(Setup(TINY))


def cases() -> dict[str, Feed]:
    found = {}
    for kind, case in by_kind(SPLATS).items():
        pairs = Pairs.of(case)
        rows, care = pairs.around()
        found[kind] = Feed({"i": pairs.pair_rows()}, {"o": rows}, care={"o": care})
    return found
