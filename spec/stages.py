"""The machine's stages, in the order in which a frame passes them: one table for all tools."""

from typing import NamedTuple


class Stage(NamedTuple):
    """A stage of the machine."""

    name: str  # also names its component, its cycles and its row in tables
    paper: str  # the stage of the paper that includes it
    half: str  # the machine's half that includes it; the halves work on two frames at once
    block: str  # the component that includes it and has its performance counters
    about: str  # its function


STAGES = (
    Stage("chunk", "stage 0", "preprocessing", "points", "skips chunks outside the view"),
    Stage("cull", "stage 0", "preprocessing", "points", "drops points behind the near plane"),
    Stage("place", "stage 1", "preprocessing", "points", "drops points outside the guard band"),
    Stage("project", "stage 1", "preprocessing", "points", "projects Gaussians to splats"),
    Stage("bin", "binning", "preprocessing", "bin", "lists splats by group of tiles"),
    Stage("sort", "stage 2", "rendering", "sort", "sorts each group's list by depth"),
    Stage("raster", "stage 3", "rendering", "raster", "blends each group's pixels"),
)
"""All stages. The paper has no binning."""

NAMES = tuple(stage.name for stage in STAGES)
"""Names of all stages."""

HALVES = {
    half: tuple(stage.name for stage in STAGES if stage.half == half)
    for half in ("preprocessing", "rendering")
}
"""Half → names of its stages."""

BLOCKS = {
    half: tuple(dict.fromkeys(stage.block for stage in STAGES if stage.half == half))
    for half in HALVES
}
"""Half → its blocks."""

OF_POINTS = tuple(stage.name for stage in STAGES if stage.block == "points")
"""Names of the stages that work on points."""
