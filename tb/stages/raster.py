"""Stage 3 as a whole: groups' splats in, finished blocks of each rasterizer out.

No tie: splats are blended in their input order, independent of their depths.
"""

from functools import partial

from splatcore.hdl.raster.raster import Raster
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.raster_cases import Case, by_kind

SPLATS = 300

component = partial(Raster, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed(case) for kind, case in by_kind(SPLATS).items()}


def feed(case: Case) -> Feed:
    blocks = {f"o__{k}": case.blocks(k) for k in range(TINY.rasterizers)}
    return Feed(
        {"i": case.featured(), "positions": case.positions()},
        {name: rows for name, (rows, _) in blocks.items()},
        case.constants | {"clear": 0},
        {name: care for name, (_, care) in blocks.items()},
    )
