"""Expand, stage 3's second step: splats in, one pair per live tile of a splat out.

No tie: it has no comparisons. No saturated: splats pass unchanged.
"""

from functools import partial

from splatcore.hdl.raster.raster import Expand
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.raster_cases import Case, Pairs, by_kind

SPLATS = 100
LIVE = {"full": (1 << TINY.group**2) - 1, "some_live": 0b0110, "none_live": 0}

component = partial(Expand, TINY)


def cases() -> dict[str, Feed]:
    given = by_kind(SPLATS)
    found = {name: feed(given["full"], live) for name, live in LIVE.items()}
    return found | {"empty": feed(given["empty"], LIVE["full"])}


def feed(case: Case, live: int) -> Feed:
    inputs = {"i": case.readied(), "positions": case.positions()}
    return Feed(inputs, {"o": Pairs.of(case, live).pair_rows()}, {"live": live})
