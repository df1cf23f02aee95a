"""Gates of the whole machine: its parts, each synthesised on its own, and their sum.

The netlist is cut at the parts' boundaries. A part, without the parts inside of it, is synthesised
as one flat piece, so all logic is counted once; as a check, the flip-flops of all pieces must be
those of the whole. Equal pieces are synthesised once. Constants do not propagate across
boundaries, and a path through several pieces is measured in each of them.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from splatcore.eda.gates.hierarchy import Hierarchy, Instance
from splatcore.eda.gates.macros import Macros, memory_name
from splatcore.eda.gates.synth import DEPTH_MAX, Netlist, rtlil_of, yosys
from splatcore.eda.paper import GATES, GATES_ALL
from splatcore.hdl.top import Top
from splatcore.sim.common.output import console, messages, progress_bar
from splatcore.sim.common.table import Column, Table
from splatcore.spec.config import Config


class Part(NamedTuple):
    """Instances that are counted together. path: regular expression for their paths."""

    stage: str
    name: str
    path: str


PATHS = {
    "stage 0": {"chunk": r"preprocess\.points\.chunk", "cull": r"preprocess\.points\.cull"},
    "stage 1": {
        "place": r"preprocess\.points\.place",
        "codebook": r"preprocess\.points\.project\.colour\.codebook",
        "colour": r"preprocess\.points\.project\.colour",
        "project": r"preprocess\.points\.project",
        "points, the rest": r"preprocess\.points",
    },
    "binning": {"list_writer": r"preprocess\.bin\.lists", "bin": r"preprocess\.bin"},
    "stage 2": {
        "sub_sorter": r"render\.sort\.runs\.sorter\d+",
        "merge": r"render\.sort\.merge",
        "sort, the rest": r"render\.sort",
        "deal": r"render\.deal",
    },
    "stage 3": {
        "prepare": r"render\.raster\.prepare",
        "setup": r"render\.raster\.setup",
        "mark": r"render\.raster\.mark",
        "evaluate": r"render\.raster\.rasterizer\d+\.evaluate",
        "blend": r"render\.raster\.rasterizer\d+\.blend",
        "quad": r"render\.raster\.\w+_quad\d+",
        "rasterizer, the rest": r"render\.raster\.rasterizer\d+",
        "raster, the rest": r"render\.raster",
    },
    "control": {
        **{name: name for name in ("axi", "registers", "frame")},
        **{name: rf"preprocess\.{name}" for name in ("model", "binned")},
        **{
            name: rf"render\.{name}"
            for name in ("groups", "lists", "long_lists", "buckets", "features", "pixels")
        },
        "top, the rest": "",
    },
}
PARTS = tuple(Part(stage, *part) for stage, paths in PATHS.items() for part in paths.items())
"""Parts of the machine; control is memory access and the host interface."""


@dataclass(frozen=True)
class Size:
    """A part's instances together.

    depth, speed_depth: maximum over the instances
    flip_flops_before: as described, before synthesis removes constant and unused flip-flops
    """

    part: Part
    count: int
    nand2: float
    depth: int
    speed_nand2: float
    speed_depth: int
    flip_flops: int
    clock_gates: int
    flip_flops_before: int
    memories: tuple[str, ...]


def netlist(config: Config) -> Hierarchy:
    """Netlist of the whole machine without its memories."""
    return Hierarchy(rtlil_of(Top(config), Macros()))


def part_of(path: str) -> Part | None:
    """The part that the instance belongs to; None if it is inside of one."""
    return next((part for part in PARTS if re.fullmatch(part.path, path)), None)


@cache
def part_around(path: str) -> str:
    """Name of the innermost part that contains a path (names separated by dots)."""
    while (part := part_of(path)) is None:
        path = path.rpartition(".")[0]
    return part.name


class Piece(NamedTuple):
    """An instance of a part: its path, and its netlist without the parts inside of it."""

    part: Part
    path: str
    netlist: Netlist


def pieces(hierarchy: Hierarchy) -> list[Piece]:
    """The instances of each part."""
    places: dict[Part, list[Instance]] = {part: [] for part in PARTS}
    for instance in hierarchy.instances():
        if part := part_of(instance.path):
            places[part].append(instance)
    return [
        Piece(part, root.path, hierarchy.piece(root, part_of))
        for part in PARTS for root in places[part]
    ]  # fmt: skip


def whole(hierarchy: Hierarchy) -> Netlist:
    """Netlist of the whole hierarchy."""
    return hierarchy.piece(Instance("", hierarchy.top), lambda _: None)


CHECK = """
delete t:$scopeinfo
tee -o check.txt check
tee -o latches.txt select -list t:$dlatch t:$adlatch t:$dlatchsr t:$sr
"""
"""Checks for latches, combinational loops, and wires with several drivers or none. The netlist must
be flat, as loops may lead through several modules."""

READ_VERILOG = """
read_verilog {files}
hierarchy -check -top {top}
proc
flatten
"""

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
    """Flip-flops as described: bits of registers and of memories with an asynchronous read port."""
    return piece.run(READ + COUNT, _count)


def _count(files: dict[str, str]) -> int:
    cells = re.findall(r"^\s*(\d+)\s+(?:\S+\s+)?\$\w*dff\w*_(\d+)\s*$", files["count.stat"], re.M)
    return sum(int(n) * int(width) for n, width in cells)


def faults_found(files: dict[str, str]) -> list[str]:
    """Faults found by `CHECK`, one per line."""
    latches = [f"latch {name}" for name in files["latches.txt"].split()]
    return latches + re.findall(r"^Warning: (.*)", files["check.txt"], re.M)


def faults(top: str, *paths: Path) -> list[str]:
    """Check Verilog files; their faults, one per line."""
    files = {path.name: path.read_text() for path in paths}
    read = READ_VERILOG.format(files=" ".join(files), top=top)
    return faults_found(yosys(read + CHECK, files))


def examined(whole: Netlist) -> dict[str, int | list[str]]:
    """Flip-flops as described, and faults, of a whole netlist."""
    return whole.run(
        READ + CHECK + COUNT,
        lambda files: {"flip_flops_before": _count(files), "faults": faults_found(files)},
    )


def sizes(hierarchy: Hierarchy, advance: Callable[..., None]) -> list[Size]:
    """Synthesise each part. advance: called with pieces done, pieces in all, and the next piece."""
    work = pieces(hierarchy)
    found: dict[Part, list[dict[str, float]]] = {}
    memories: dict[Part, list[str]] = {}
    for done, (part, _, piece) in enumerate(work):
        advance(done, len(work), f"synthesising {part.name}")
        counts = piece.gates() | {"flip_flops_before": flip_flops_before(piece)}
        found.setdefault(part, []).append(counts)
        memories.setdefault(part, []).extend(memory_name(*size) for size in piece.memories)
    whole = []
    for part, all in found.items():  # sums, but maximum depths
        size = {k: (max if "depth" in k else sum)(each[k] for each in all) for k in all[0]}
        whole.append(Size(part, len(all), **size, memories=tuple(memories[part])))
    return whole


def parts_table(
    title: str, columns: Sequence[Column], found: list, row: Callable[[list, int | None], dict]
) -> Table:
    """Table of parts, with a row per stage and per part of it, and one for all.

    found: sizes of the parts, each with its `part`
    row: of some of them and the paper's gates, None for a part
    """
    rows, strong = [], []
    for stage, parts in groupby(found, key=lambda size: size.part.stage):
        parts = list(parts)
        strong.append(len(rows))
        rows.append({"part": stage} | row(parts, GATES.get(stage)))
        rows += [{"part": f"  {size.part.name}"} | row([size], None) for size in parts]
    strong.append(len(rows))
    rows.append({"part": "all"} | row(found, GATES_ALL))
    return Table.of("parts", title, [Column("part"), *columns], rows, frozenset(strong))


COLUMNS = (
    Column("count", digits=0, none=""),
    *(
        Column(name, digits=1, get=key, per=1000, none="")
        for name, key in {"each": "each", "all": "nand2", "for speed": "speed_nand2"}.items()
    ),
    Column("depth", digits=0),
    Column("paper", digits=1, per=1000, none=""),
)
"""Columns of the gates of a machine's parts."""


def synthesise_machine(config: Config) -> dict:
    """Print the gates of all parts of a machine and the paper's; return them for a JSON file."""
    with progress_bar("elaborating the machine") as advance:
        hierarchy = netlist(config)
        found = sizes(hierarchy, advance)
        advance(0, 1, "checking the machine")
        about = examined(whole(hierarchy))
    title = f"preset {config.name}; thousands of NAND2; depth for speed ≤ {DEPTH_MAX}"
    parts_table(title, COLUMNS, found, _row).print()
    parted = sum(size.flip_flops_before for size in found)
    console.print(
        f"Flip-flops as described: {parted:,} in the parts, {about['flip_flops_before']:,} in the "
        f"whole. Latches, loops, wires with several drivers or none: {len(about['faults'])}."
    )
    for fault in about["faults"]:
        messages.print(fault, markup=False, soft_wrap=True)
    return {
        "nand2": sum(size.nand2 for size in found),
        "speed_nand2": sum(size.speed_nand2 for size in found),
        "paper_nand2": GATES_ALL,
        "flip_flops_before": {"parts": parted, "whole": about["flip_flops_before"]},
        "faults": about["faults"],
        "parts": {size.part.name: _facts(size) for size in found},
    }


def _row(sizes: list[Size], paper: int | None) -> dict:
    """A row of the table: sums, and the maximum depth."""
    nand2, speed = (sum(getattr(size, k) for size in sizes) for k in ("nand2", "speed_nand2"))
    count = sizes[0].count if len(sizes) == 1 else None
    return {
        "count": count, "each": (count and nand2 / count) or None, "nand2": nand2 or None,
        "speed_nand2": speed or None, "depth": max(size.speed_depth for size in sizes),
        "paper": paper,
    }  # fmt: skip


def _facts(size: Size) -> dict:
    """A part's sizes for a JSON file."""
    return {"stage": size.part.stage} | {k: v for k, v in vars(size).items() if k != "part"}
