"""A rasterizer: pairs with its blocks in, the groups' finished blocks out.

No tie: splats are blended in their input order, independent of their depths.
"""

from functools import partial

from splatcore.hdl.raster.rasterizer import Rasterizer
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.raster_cases import Case, Pairs, by_kind

NUMBER = 1  # of the machine's rasterizers
SPLATS = 300

component = partial(Rasterizer, TINY, NUMBER)


def cases() -> dict[str, Feed]:
    return {kind: feed(case) for kind, case in by_kind(SPLATS).items()}


def feed(case: Case) -> Feed:
    rows, care = case.blocks(NUMBER)
    inputs = {"i": Pairs.of(case).owned(NUMBER), "positions": case.positions()}
    return Feed(inputs, {"o": rows}, case.constants, {"o": care})
