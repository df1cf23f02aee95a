"""Gates of the whole machine: its parts, each synthesised on its own, and their sum.

The netlist of the whole is cut at the parts' boundaries. What is inside a part and outside the
parts in it is synthesised as one flat piece, so all is in one piece and nothing in two: flip-flops
are counted in the whole as well, and must be as many. Equal pieces are synthesised once. No
constant passes a boundary, and a path through several pieces is measured in each of them.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from amaranth.back import rtlil

from splatcore.hdl.top import Top
from splatcore.sim.eda.check import CHECK, faults_found
from splatcore.sim.eda.hierarchy import Hierarchy, Instance
from splatcore.sim.eda.macros import Macros, memory_name
from splatcore.sim.eda.synth import Netlist
from splatcore.spec.config import Config


class Part(NamedTuple):
    """Instances that are counted as one thing. path: a pattern of their paths."""

    stage: str
    name: str
    path: str


PATHS = {
    "stage 0": {"chunk": r"preprocess\.points\.chunk", "cull": r"preprocess\.points\.cull"},
    "stage 1": {
        "place": r"preprocess\.points\.place",
        "project": r"preprocess\.points\.project",
        "points, the rest": r"preprocess\.points",
    },
    "binning": {"bin": r"preprocess\.bin"},
    "stage 2": {
        "sub_sorter": r"render\.sort\.runs\.sorter\d+",
        "merge": r"render\.sort\.merge",
        "sort, the rest": r"render\.sort",
    },
    "stage 3": {
        "prepare": r"render\.raster\.prepare",
        "setup": r"render\.raster\.setup",
        "mark": r"render\.raster\.mark",
        "evaluate": r"render\.raster\.rasterizer\d+\.evaluate",
        "blend": r"render\.raster\.rasterizer\d+\.blend",
        "rasterizer, the rest": r"render\.raster\.rasterizer\d+",
        "raster, the rest": r"render\.raster",
    },
    "control": {
        **{name: name for name in ("axi", "registers", "frame")},
        **{name: rf"preprocess\.{name}" for name in ("model", "binned")},
        **{
            name: rf"render\.{name}"
            for name in ("groups", "lists", "scratch", "features", "pixels")
        },
        "top, the rest": "",
    },
}
PARTS = tuple(Part(stage, *part) for stage, paths in PATHS.items() for part in paths.items())
"""Parts of the machine; control is memory access and the host's side."""


@dataclass(frozen=True)
class Size:
    """A part's instances together; depths are those of the deepest. flip_flops_before: what their
    descriptions ask for, before synthesis has taken away what is constant or read by nobody.
    """

    part: Part
    count: int
    nand2: float
    depth: int
    speed_nand2: float
    speed_depth: int
    flip_flops: int
    flip_flops_before: int
    memories: tuple[str, ...]


def netlist(config: Config) -> Hierarchy:
    """The whole machine without its memories."""
    return Hierarchy(rtlil.convert(Top(config), name="top", platform=Macros(), emit_src=False))


def part_of(path: str) -> Part | None:
    """The part whose instance that is."""
    return next((part for part in PARTS if re.fullmatch(part.path, path)), None)


def pieces(hierarchy: Hierarchy) -> list[tuple[Part, Netlist]]:
    """Each instance of each part, cut out."""
    places: dict[Part, list[Instance]] = {part: [] for part in PARTS}
    for instance in hierarchy.instances():
        if part := part_of(instance.path):
            places[part].append(instance)
    return [(part, hierarchy.piece(root, part_of)) for part in PARTS for root in places[part]]


def whole(hierarchy: Hierarchy) -> Netlist:
    """All of it."""
    return hierarchy.piece(Instance("", hierarchy.top), lambda _: None)


READ = """
read_rtlil top.il
read_verilog -lib macros.v
hierarchy -top top
proc
flatten
"""

COUNT = """
memory_collect
memory_map
tee -o count.stat stat -width
"""


def flip_flops_before(piece: Netlist) -> int:
    """Bits of registers and of memories that are read in the same cycle, as they are described."""
    return piece.run(READ + COUNT, _count)


def _count(files: dict[str, str]) -> int:
    cells = re.findall(r"^\s*(\d+)\s+(?:\S+\s+)?\$\w*dff\w*_(\d+)\s*$", files["count.stat"], re.M)
    return sum(int(n) * int(width) for n, width in cells)


def examined(whole: Netlist) -> dict[str, int | list[str]]:
    """Flip-flops of a whole netlist, and its faults."""
    return whole.run(
        READ + CHECK + COUNT,
        lambda files: {"flip_flops_before": _count(files), "faults": faults_found(files)},
    )


def sizes(hierarchy: Hierarchy, advance: Callable[..., None]) -> list[Size]:
    """Gates of each part. advance: told of the pieces done, of all, and which is next."""
    work = pieces(hierarchy)
    found: dict[Part, list[dict[str, float]]] = {part: [] for part, _ in work}
    for done, (part, piece) in enumerate(work):
        advance(done, len(work), f"synthesising {part.name}")
        found[part].append(piece.gates() | {"flip_flops_before": flip_flops_before(piece)})
    memories: dict[Part, list[str]] = {part: [] for part in found}
    for part, piece in work:
        memories[part] += (memory_name(*size) for size in piece.memories)
    return [
        Size(part, len(all), **_together(all), memories=tuple(memories[part]))
        for part, all in found.items()
    ]


def _together(all: list[dict[str, float]]) -> dict[str, float]:
    """Sizes of several pieces: the sum, of depths the largest."""
    return {key: (max if "depth" in key else sum)(each[key] for each in all) for key in all[0]}
