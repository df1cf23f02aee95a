"""Cull: points in, those in front of the near plane out; a full chunk, points on the near plane."""

from functools import partial

from splatcore.hdl.points.cull import Cull
from splatcore.spec.config import TINY
from tb.helpers.feeds import KINDS, Feed
from tb.helpers.point_cases import feed

GAUSSIANS = 300  # a full chunk and a part of one

component = partial(Cull, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed("cull", kind, GAUSSIANS) for kind in KINDS}
