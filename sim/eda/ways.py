"""In which of several ways each part of the machine is mapped to cells."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from splatcore.sim.eda.cell_netlist import MEMORY, CellNetlist, put_together
from splatcore.sim.eda.liberty import Library
from splatcore.sim.eda.mapping import PASSES, SUMS, Mapped, mapped
from splatcore.sim.eda.static_timing import Assumed, Path, Timing
from splatcore.sim.eda.synth import Netlist

LONG_FO4 = 45
"""Paths that take longer are named: 0.9 · 1.25 ns / 25 ps, what 800 MHz leave room for."""

ALONE_FO4 = 44.5
"""What a part may take on its own: a path from a part before it may begin later than one from a
register at its port, as it is assumed there."""


def ways(netlist: Netlist, library: Library, passes: int) -> Iterator[Mapped]:
    """A netlist in cells, its sums made in each way of `SUMS`."""
    return (mapped(netlist, library, sums, passes) for sums in SUMS)


def cost(piece: Mapped, library: Library) -> tuple[float, float]:
    """FO4 of a part's longest path, or `ALONE_FO4` if it is shorter; its um².

    Of blocks that are no memory nothing is known here: paths end at them.
    """
    assumed = Assumed.of(library, False)
    blocks = [block for block in piece.blocks if block[0].startswith(MEMORY)]
    alone = put_together(library, {"": replace(piece, blocks=blocks)})
    path = Timing(alone, assumed).longest
    return max(path.time / assumed.fo4 if path else 0, ALONE_FO4), alone.area


def fastest(netlist: Netlist, library: Library) -> Mapped:
    """The smallest of a netlist's `ways` whose longest path is not above `ALONE_FO4`; if all are,
    with a pass more; the fastest one if all still are."""
    found: list[tuple[tuple[float, float], Mapped]] = []
    for passes in (PASSES, PASSES + 1):
        found += [(cost(way, library), way) for way in ways(netlist, library, passes)]
        least, best = min(found, key=lambda each: each[0])
        if least[0] <= ALONE_FO4:
            break
    return best


class Trial(NamedTuple):
    """The machine put together from pieces by their paths. fo4: of its longest path, `LONG_FO4` if
    it is shorter."""

    fo4: float
    path: Path
    pieces: dict[str, Mapped]
    whole: CellNetlist


def settled(
    netlists: Mapping[str, Netlist], found: Mapping[str, Mapped], library: Library
) -> tuple[CellNetlist, dict[str, Mapped]]:
    """The machine put together, and its pieces by the path of their instance. netlists: theirs;
    found: a way for each of their texts.

    As long as the longest path is longer than `LONG_FO4` and leads through several parts, all ways
    of each of these are tried, from its end on, until one makes it shorter.
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
    """The instances in which a path is, from its end on, each once."""
    names = [path.end[1], *(net for _, net, _, _ in reversed(path.steps)), path.begin[1]]
    yield from dict.fromkeys(innermost(name, instances) for name in names)


def innermost(name: str, instances: Mapping[str, object]) -> str:
    """The innermost of some instances in which a name of the whole is; "" is the whole."""
    while name not in instances:
        name = name.rpartition(".")[0]
    return name
