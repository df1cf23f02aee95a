"""Place: points in front in, points in the guard band out. Tie: points at its bounds."""

from functools import partial

from splatcore.hdl.points.place import Place
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.point_cases import at_the_bounds, feed

GAUSSIANS = 300  # a full chunk and a part of one

component = partial(Place, TINY)


def cases() -> dict[str, Feed]:
    found = {kind: feed("place", kind, GAUSSIANS) for kind in ("empty", "full", "saturated")}
    return found | {"tie": at_the_bounds(GAUSSIANS)}
