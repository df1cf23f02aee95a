"""Choice of the way in which each part of the machine is mapped to cells."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from splatcore.eda.cells.cell_netlist import MEMORY, CellNetlist, put_together
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.mapping import EFFORTS, SUMS, Mapped, mapped
from splatcore.eda.cells.static_timing import Assumed, Path, Timing
from splatcore.eda.gates.synth import Netlist

LONG_FO4 = 45
"""Longest path for 800 MHz: 0.9 · 1.25 ns / 25 ps. Longer paths are listed."""

WIRED_FO4 = 50
"""Longest path with wires: 0.9 · 1.25 ns / 22.5 ps."""

WHOLE, ALONE = (LONG_FO4, WIRED_FO4), (44.5, 49.5)
"""Longest paths without and with wires, of the machine and of a part on its own; of the latter a
bit less: paths from other parts may arrive later than those from the assumed registers at its
ports."""


def ways(netlist: Netlist, library: Library, effort: tuple[int, int]) -> Iterator[Mapped]:
    """Map a netlist to cells in each way of `SUMS`. effort: one of `EFFORTS`"""
    return (mapped(netlist, library, sums, effort) for sums in SUMS)


def longest(
    netlist: CellNetlist, library: Library, limits: tuple[float, float]
) -> tuple[float, Path | None]:
    """The longest path, in units of its limit, and the path itself: without or with wires,
    whichever is closer to its limit or beyond it.

    limits: FO4 without and with wires
    """
    found = []
    for wires, limit in enumerate(limits):
        assumed = Assumed.of(library, bool(wires))
        path = Timing(netlist, assumed).longest
        found.append((path.time / assumed.fo4 / limit if path else 0, path))
    return max(found, key=lambda each: each[0])


def cost(piece: Mapped, library: Library) -> tuple[float, float]:
    """Longest path of a part in units of its limit, at least 1; and its um².

    Blocks other than memories are unknown here: paths end at them.
    """
    blocks = [block for block in piece.blocks if block[0].startswith(MEMORY)]
    alone = put_together(library, {"": replace(piece, blocks=blocks)})
    return max(longest(alone, library, ALONE)[0], 1), alone.area


def fastest(netlist: Netlist, library: Library) -> Mapped:
    """The smallest of a netlist's `ways` whose longest paths are within `ALONE`; with more effort
    if there is none; else the fastest of all."""
    found: list[tuple[tuple[float, float], Mapped]] = []
    for effort in EFFORTS:
        found += [(cost(way, library), way) for way in ways(netlist, library, effort)]
        least, best = min(found, key=lambda each: each[0])
        if least[0] <= 1:
            break
    return best


class Trial(NamedTuple):
    """The machine assembled from a choice of pieces.

    late: its longest path in units of its limit in `WHOLE`, at least 1
    path: the longest path
    pieces: by path of the instance
    whole: the netlist
    """

    late: float
    path: Path
    pieces: dict[str, Mapped]
    whole: CellNetlist


def settled(
    netlists: Mapping[str, Netlist], found: Mapping[str, Mapped], library: Library
) -> tuple[CellNetlist, dict[str, Mapped]]:
    """Assemble the machine, and improve its longest path.

    netlists: by path of the instance
    found: mapped netlist by text of the netlist
    While the longest path is beyond `WHOLE` and crosses several parts, all ways of each of these
    parts are tried, from the path's end on, until one shortens it.
    Returns the whole netlist, and its pieces by path of the instance.
    """
    found = dict(found)

    def together(found: Mapping[str, Mapped]) -> Trial:
        pieces = {path: found[netlist.text] for path, netlist in netlists.items()}
        whole = put_together(library, pieces)
        late, path = longest(whole, library, WHOLE)
        return Trial(max(late, 1), path, pieces, whole)

    def better(now: Trial) -> Trial | None:
        parts = list(parts_of(now.path, netlists))
        for part in parts if len(parts) > 1 else ():
            netlist = netlists[part]
            trials = (
                (together(found | {netlist.text: way}), way)
                for effort in EFFORTS
                for way in ways(netlist, library, effort)
            )
            trial, way = min(trials, key=lambda each: (each[0].late, each[0].whole.area))
            if trial.late < now.late:
                found[netlist.text] = way
                return trial
        return None

    now = together(found)
    while now.late > 1 and (next_ := better(now)):
        now = next_
    return now.whole, now.pieces


def parts_of(path: Path, instances: Mapping[str, object]) -> Iterator[str]:
    """The instances that a path crosses, from its end on, each once."""
    names = [path.end[1], *(net for _, net, _, _ in reversed(path.steps)), path.begin[1]]
    yield from dict.fromkeys(innermost(name, instances) for name in names)


def innermost(name: str, instances: Mapping[str, object]) -> str:
    """The innermost of some instances that contains a name; "" is the top."""
    while name not in instances:
        name = name.rpartition(".")[0]
    return name
