"""Choice of the way in which each part of the machine is mapped to cells."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from splatcore.eda.cells.cell_netlist import MEMORY, CellNetlist, put_together
from splatcore.eda.cells.liberty import Library
from splatcore.eda.cells.mapping import PASSES, SUMS, Mapped, mapped
from splatcore.eda.cells.static_timing import Assumed, Path, Timing
from splatcore.eda.gates.synth import Netlist

LONG_FO4 = 45
"""Longest path for 800 MHz: 0.9 · 1.25 ns / 25 ps. Longer paths are listed."""

ALONE_FO4 = 44.5
"""Longest path of a part on its own, a bit less: paths from other parts may arrive later than those
from the assumed registers at its ports."""


def ways(netlist: Netlist, library: Library, passes: int) -> Iterator[Mapped]:
    """Map a netlist to cells in each way of `SUMS`."""
    return (mapped(netlist, library, sums, passes) for sums in SUMS)


def cost(piece: Mapped, library: Library) -> tuple[float, float]:
    """FO4 of a part's longest path, at least `ALONE_FO4`; and its um².

    Blocks other than memories are unknown here: paths end at them.
    """
    assumed = Assumed.of(library, False)
    blocks = [block for block in piece.blocks if block[0].startswith(MEMORY)]
    alone = put_together(library, {"": replace(piece, blocks=blocks)})
    path = Timing(alone, assumed).longest
    return max(path.time / assumed.fo4 if path else 0, ALONE_FO4), alone.area


def fastest(netlist: Netlist, library: Library) -> Mapped:
    """The smallest of a netlist's `ways` whose longest path is at most `ALONE_FO4`; with one more
    pass if there is none; else the fastest of all."""
    found: list[tuple[tuple[float, float], Mapped]] = []
    for passes in (PASSES, PASSES + 1):
        found += [(cost(way, library), way) for way in ways(netlist, library, passes)]
        least, best = min(found, key=lambda each: each[0])
        if least[0] <= ALONE_FO4:
            break
    return best


class Trial(NamedTuple):
    """The machine assembled from a choice of pieces.

    fo4: of its longest path, at least `LONG_FO4`
    path: the longest path
    pieces: by path of the instance
    whole: the netlist
    """

    fo4: float
    path: Path
    pieces: dict[str, Mapped]
    whole: CellNetlist


def settled(
    netlists: Mapping[str, Netlist], found: Mapping[str, Mapped], library: Library
) -> tuple[CellNetlist, dict[str, Mapped]]:
    """Assemble the machine, and improve its longest path.

    netlists: by path of the instance
    found: mapped netlist by text of the netlist
    While the longest path is longer than `LONG_FO4` and crosses several parts, all ways of each of
    these parts are tried, from the path's end on, until one shortens it.
    Returns the whole netlist, and its pieces by path of the instance.
    """
    assumed, found = Assumed.of(library, False), dict(found)

    def together(found: Mapping[str, Mapped]) -> Trial:
        pieces = {path: found[netlist.text] for path, netlist in netlists.items()}
        whole = put_together(library, pieces)
        path = Timing(whole, assumed).longest
        return Trial(max(path.time / assumed.fo4, LONG_FO4), path, pieces, whole)

    def better(now: Trial) -> Trial | None:
        parts = list(parts_of(now.path, netlists))
        for part in parts if len(parts) > 1 else ():
            netlist = netlists[part]
            trials = (
                (together(found | {netlist.text: way}), way)
                for passes in (PASSES, PASSES + 1)
                for way in ways(netlist, library, passes)
            )
            trial, way = min(trials, key=lambda each: (each[0].fo4, each[0].whole.area))
            if trial.fo4 < now.fo4:
                found[netlist.text] = way
                return trial
        return None

    now = together(found)
    while now.fo4 > LONG_FO4 and (next_ := better(now)):
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
