"""Prepare, stage 3's first step: features in, integers for setup out.

No tie: it has no comparisons.
"""

from functools import partial

from splatcore.hdl.raster.prepare import Prepare
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.raster_cases import by_kind

SPLATS = 200

component = partial(Prepare, TINY)


def cases() -> dict[str, Feed]:
    return {
        kind: Feed({"i": case.featured()}, {"o": case.readied()})
        for kind, case in by_kind(SPLATS).items()
    }
