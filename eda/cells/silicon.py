"""Area and longest paths in cells of a library, and estimates of both at 28 nm."""

import os
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

from amaranth.lib import wiring

from splatcore.eda import paper
from splatcore.eda.cells.cell_netlist import MEMORY, CellNetlist, put_together
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.mapping import Mapped
from splatcore.eda.cells.static_timing import Assumed, Path, Timing
from splatcore.eda.cells.ways import LONG_FO4, fastest, settled
from splatcore.eda.gates.hierarchy import Hierarchy
from splatcore.eda.gates.machine_gates import Part, part_around, pieces
from splatcore.eda.gates.synth import Netlist

FO4_28NM = (0.022, 0.025)
"""ns per FO4 in 28 nm at the slow corner. ASSUMED: both ends of the range reported for such
processes. The library may be of another corner: depths in FO4 hardly depend on it."""

UNCERTAINTY = 0.1
"""Share of the period for skew and jitter of the clock. ASSUMED; setup times are in the paths."""

ADVANCE = Callable[..., None]


@dataclass(frozen=True)
class Silicon:
    """A netlist of cells and its timing.

    timing: of all paths, without wires
    registers: of paths between registers only
    wired: of all paths, with wires
    """

    netlist: CellNetlist
    assumed: Assumed
    timing: Timing
    registers: Timing
    wired: Timing

    @classmethod
    def of(cls, netlist: CellNetlist) -> "Silicon":
        """Analyse a netlist."""
        plain, wires = (Assumed.of(netlist.library, each) for each in (False, True))
        return cls(
            netlist, plain, Timing(netlist, plain), Timing(netlist, plain, True),
            Timing(netlist, wires),
        )  # fmt: skip

    @cached_property
    def facts(self) -> dict:
        """Sizes and longest paths, for a table and a JSON file."""
        library, netlist = self.netlist.library, self.netlist
        return {
            "um2": netlist.area,
            "nand2": netlist.area / library.nand2.area,
            "cells": len(netlist.kinds),
            "flip_flops": int(netlist.is_flip_flop.sum()),
            "flip_flops_um2": float(netlist.areas[netlist.is_flip_flop].sum()),
            "clock_gates": int(netlist.is_clock_gate.sum()),
            "gated": netlist.gated,
            "buffers": int(netlist.is_buffer.sum()),
            "memories": len(netlist.memories),
            "longest": self.path_facts(self.timing.longest),
            "between_registers": self.path_facts(self.registers.longest),
            "longest_with_wires": self.path_facts(self.wired.longest),
        }

    def path_facts(self, path: Path | None) -> dict | None:
        """A path for a JSON file, with the clock frequency that it allows at 28 nm."""
        if path is None:
            return None
        depth = path.time / self.assumed.fo4
        return {
            "ps": 1000 * path.time,
            "fo4": depth,
            "mhz_28nm": [1000 * (1 - UNCERTAINTY) / (depth * unit) for unit in FO4_28NM[::-1]],
            "from": dict(zip(("kind", "name"), path.begin, strict=True)),
            "to": dict(zip(("kind", "name"), path.end, strict=True)),
            "cells": [
                {"cell": cell, "net": net, "ps": 1000 * time, "loads": loads}
                for cell, net, time, loads in path.steps
            ],
        }


def silicon(component: wiring.Component, library: Library) -> Silicon:
    """Map a component on its own to a library, with registers on the other side of its ports."""
    return silicon_of(Netlist.of(component), library)


def silicon_of(rtl: Netlist, library: Library) -> Silicon:
    """`silicon` of a component that is converted already."""
    return Silicon.of(put_together(library, {"": fastest(rtl, library)}))


@dataclass(frozen=True)
class Placed:
    """A part of the machine: its instances together.

    buffers: share of buffers in its cells
    fo4, fo4_wires: longest path of one instance on its own, without and with wires; None if it
        contains other parts
    """

    part: Part
    count: int
    um2: float
    flip_flops: int
    buffers: float
    fo4: float | None
    fo4_wires: float | None

    @classmethod
    def of(cls, part: Part, pieces: list[Mapped], library: Library) -> "Placed":
        """Sum up a part's pieces, one per instance."""
        counts = Counter(kind for piece in pieces for kind, _, _ in piece.cells)
        cells = [(library.cells[kind], count) for kind, count in counts.items()]
        buffers = sum(count for cell, count in cells if cell.computes(0, 1))
        depths = [None, None]
        if all(module.startswith(MEMORY) for module, _, _ in pieces[0].blocks):
            netlist = put_together(library, {"": pieces[0]})
            assumed = [Assumed.of(library, wires) for wires in (False, True)]
            longest = [Timing(netlist, each).longest for each in assumed]
            depths = [path and path.time / assumed[0].fo4 for path in longest]
        area = sum(cell.area * count for cell, count in cells)
        flip_flops = sum(count for cell, count in cells if cell.is_flip_flop)
        share = buffers / (counts.total() or 1)
        return cls(part, len(pieces), area, flip_flops, share, *depths)


def machine_silicon(
    hierarchy: Hierarchy, library: Library, advance: ADVANCE
) -> tuple[list[Placed], Silicon]:
    """Map the machine's parts separately, and assemble them for paths through several parts.

    advance: called with pieces done, pieces in all, and the current step
    """
    work = pieces(hierarchy)
    unique = {piece.netlist.text: piece.netlist for piece in work}
    order = sorted(unique, key=len, reverse=True)  # the longest first, to keep all threads busy
    found, steps = {}, len(order) + 2
    advance(0, steps, "mapping the machine")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        mapping = pool.map(lambda text: fastest(unique[text], library), order)
        for done, (text, mapped) in enumerate(zip(order, mapping, strict=True)):
            found[text] = mapped
            advance(done + 1, steps, "mapping the machine")
    advance(len(order), steps, "assembling the machine")
    netlist, chosen = settled({piece.path: piece.netlist for piece in work}, found, library)
    advance(len(order) + 1, steps, "timing the machine")
    parts: dict[Part, list[Mapped]] = {}
    for piece in work:
        parts.setdefault(piece.part, []).append(chosen[piece.path])
    placed = [Placed.of(part, each, library) for part, each in parts.items()]
    return placed, Silicon.of(netlist)


def long_paths(timing: Timing, fo4: float = LONG_FO4) -> list[dict]:
    """Paths longer than `fo4`, by the parts in which they begin and end: the number of ends, and
    the longest path."""
    found: dict[tuple[str, str], dict] = {}
    for time, kind, name, net, edge in timing.worst(fo4 * timing.assumed.fo4):
        begin = timing.begin_of(timing.origin[net, edge])
        places = part_at(begin), part_at((kind, name))
        row = found.setdefault(places, {
            "from_part": places[0], "to_part": places[1], "ends": 0,
            "fo4": round(time / timing.assumed.fo4, 1), "ps": round(1000 * time),
            "from": f"{begin[0]} {begin[1]}", "to": f"{kind} {name}",
        })  # fmt: skip
        row["ends"] += 1
    return list(found.values())


def ends_by_part(timing: Timing) -> dict[str, float]:
    """FO4 of the longest path that ends in each part."""
    found: dict[str, float] = {}
    for row in long_paths(timing, 0.0):
        found[row["to_part"]] = max(row["fo4"], found.get(row["to_part"], 0.0))
    return found


def part_at(end: tuple[str, str]) -> str:
    """The part that contains a register or memory; "port" for a port."""
    kind, name = end
    return kind if kind == "port" else part_around(name)


def area_28nm(nand2: float, kilobytes: float) -> dict[str, float]:
    """mm² of logic and of memories at 28 nm, by the paper's area per gate and per KB."""
    return {
        "logic_mm2": nand2 * paper.UM2_PER_GATE / 1e6,
        "memories_mm2": kilobytes * paper.UM2_PER_KB / 1e6,
    }
