"""Mark, stage 3's fourth step: E around tiles in, the same with the blocks that it may reach out.
Tie: blocks that E reaches exactly."""

from splatcore.hdl.raster.mark import Mark
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.parts import Handshake
from tb.helpers.raster_cases import Pairs, by_kind, exactly_reached

SPLATS = 100


def component() -> Handshake:
    return Handshake(Mark(TINY))


def cases() -> dict[str, Feed]:
    found = {kind: Pairs.of(case) for kind, case in by_kind(SPLATS).items()}
    found["tie"] = exactly_reached(found["full"])
    return {
        kind: Feed({"i": pairs.around()[0]}, {"o": pairs.marked()}) for kind, pairs in found.items()
    }
