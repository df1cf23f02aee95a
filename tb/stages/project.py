"""Project: points in the guard band and their attributes in, splats out.

No tie: it has no comparisons of splats.
"""

from functools import partial

from splatcore.hdl.points.project import Project
from splatcore.spec.config import TINY
from tb.helpers.feeds import Feed
from tb.helpers.point_cases import feed

GAUSSIANS = 200

component = partial(Project, TINY)


def cases() -> dict[str, Feed]:
    return {kind: feed("project", kind, GAUSSIANS) for kind in ("empty", "full", "saturated")}
