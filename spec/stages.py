"""The stages of the machine, in the order in which a frame passes them: one table for all tools."""

from typing import NamedTuple


class Stage(NamedTuple):
    """A stage. name: also of its component, of its cycles and of its row in tables.

    paper: the paper's stage that it belongs to; half: of the machine, whose halves work on two
    frames at once; block: the component that it is or is in, which has performance counters.
    """

    name: str
    paper: str
    half: str
    block: str
    about: str


STAGES = (
    Stage("chunk", "stage 0", "preprocessing", "points", "skips chunks that are out of sight"),
    Stage("cull", "stage 0", "preprocessing", "points", "drops points behind the near plane"),
    Stage("place", "stage 1", "preprocessing", "points", "drops points outside the guard band"),
    Stage("project", "stage 1", "preprocessing", "points", "makes splats of Gaussians"),
    Stage("bin", "binning", "preprocessing", "bin", "writes lists of splats, by group of tiles"),
    Stage("sort", "stage 2", "rendering", "sort", "sorts each group's list by depth"),
    Stage("raster", "stage 3", "rendering", "raster", "blends each group's pixels"),
)
"""All of them. The paper has no binning."""

NAMES = tuple(stage.name for stage in STAGES)

HALVES = {
    half: tuple(stage.name for stage in STAGES if stage.half == half)
    for half in ("preprocessing", "rendering")
}
"""Stages of each half."""

BLOCKS = {
    half: tuple(dict.fromkeys(stage.block for stage in STAGES if stage.half == half))
    for half in HALVES
}
"""Blocks of each half."""

OF_POINTS = tuple(stage.name for stage in STAGES if stage.block == "points")
"""Stages that work on points."""
