"""Chunk: headers of a model's chunks in, headers of chunks in view out.

No tie: a chunk's bounds are rounded outward, so no camera puts one exactly on the near plane.
"""

from functools import partial

from splatcore.hdl.points.chunk import Chunk
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.point_cases import feed

GAUSSIANS = 2500  # ten chunks, the last one not full

component = partial(Chunk, TINY)


def cases() -> dict[str, Feed]:
    kinds = {"empty": "behind", "full": "full", "saturated": "saturated"}
    return {name: feed("chunk", kind, GAUSSIANS) for name, kind in kinds.items()}
