"""Cull: points in, points in front of the near plane out. Full: a full chunk. Tie: on the plane."""

from functools import partial

from splatcore.hdl.points.cull import Cull
from splatcore.spec.config import TINY
from tb.helpers.feeds import KINDS, Feed
from tb.helpers.point_cases import feed

GAUSSIANS = 300  # a full chunk and a part of one

component = partial(Cull, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed("cull", kind, GAUSSIANS) for kind in KINDS}
