"""A routed layout, read from the router's files: cells, wires and RC trees."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

from splatcore.eda.route.lef import Lef

Wire = tuple[str, tuple[float, float], tuple[float, float]]
"""A layer, and both ends of a straight wire in µm."""

Tree = tuple[float, float, str | None, list["Tree"]]
"""A segment: ohm, pF, the pin ("instance/pin") at its end if any, the segments that begin there."""


@dataclass(frozen=True)
class Routed:
    """A routed layout.

    area: µm of its corners, x and y of each
    cells: kind and lower left corner in µm, by instance
    pins: "instance/pin" and "PIN/net" of all pins and pads that each net connects
    wires: of each net; none for a net whose pins touch
    trees: driving pin, number of sinks and tree of each net, by the router; it writes ERROR for a
        pin that it reaches through another one
    failed: number of nets that could not be routed
    """

    area: tuple[float, float, float, float]
    cells: dict[str, tuple[str, float, float]]
    pins: dict[str, list[str]]
    wires: dict[str, list[Wire]]
    trees: dict[str, tuple[str, int, Tree]]
    failed: int

    @classmethod
    def read(cls, folder: Path) -> "Routed":
        """Read routed.def, routed.rc and the router's log. Raises ValueError if they do not
        match."""
        text = (folder / "routed.def").read_text()
        units = float(re.search(r"UNITS DISTANCE MICRONS (\d+)", text)[1])
        corners = re.search(r"DIEAREA \( (\S+) (\S+) \) \( (\S+) (\S+) \)", text).groups()
        cells = {
            name: (kind, float(x) / units, float(y) / units)
            for name, kind, x, y in re.findall(
                r"^- (\S+) (\S+) \+ PLACED \( (\S+) (\S+) \)", text, re.M
            )
        }
        pins, wires = {}, {}
        section = text[text.index("\nNETS ") : text.index("\nEND NETS")]
        for net in section.split("\n- ")[1:]:
            name, _, rest = net.partition("\n")
            ends, _, routes = rest.partition("+ ROUTED")
            pins[name.strip()] = ["/".join(end) for end in re.findall(r"\( (\S+) (\S+) \)", ends)]
            wires[name.strip()] = list(_wires(routes, units))
        trees = dict(_tree_of(line) for line in (folder / "routed.rc").read_text().splitlines())
        if unknown := trees.keys() - wires.keys():
            raise ValueError(f"routed.rc: {len(unknown)} nets are not in routed.def")
        log = (folder / "routed.rc.log").read_text()
        count = re.findall(r"^Final: (?:No|(\d+)) failed routes", log, re.M)
        failed = int(count[-1] or 0) if count else len(wires)
        return cls(tuple(float(c) / units for c in corners), cells, pins, wires, trees, failed)

    @cached_property
    def sinks(self) -> dict[str, int]:
        """Number of sinks of each net."""
        return {name: len(pins) - 1 for name, pins in self.pins.items()}

    @cached_property
    def lengths(self) -> dict[str, dict[str, float]]:
        """µm of each net's wires by layer."""
        found: dict[str, dict[str, float]] = {}
        for name, wires in self.wires.items():
            by_layer = found.setdefault(name, {})
            for layer, (x0, y0), (x1, y1) in wires:
                by_layer[layer] = by_layer.get(layer, 0.0) + abs(x1 - x0) + abs(y1 - y0)
        return found

    def capacitances(self, lef: Lef) -> dict[str, float]:
        """pF of each net's wires."""
        return {name: lef.capacitance(lengths) for name, lengths in self.lengths.items()}


def _wires(text: str, units: float) -> Iterator[Wire]:
    """The wires of a net's text "LAYER ( x y ) ( * y ) VIA NEW LAYER ...", without vias."""
    for layer, route in re.findall(r"(?:^|NEW)\s+(\w+)((?:\s+\([^)]*\))+)", text):
        at: list[tuple[float, float]] = []
        for x, y in re.findall(r"\(\s*(\S+)\s+(\S+)[^)]*\)", route):
            here = at[-1] if at else (0.0, 0.0)
            at.append((
                here[0] if x == "*" else float(x) / units,
                here[1] if y == "*" else float(y) / units,
            ))  # fmt: skip
        for pair in pairwise(at):
            if pair[0] != pair[1]:
                yield layer, *pair


def _tree_of(line: str) -> tuple[str, tuple[str, int, Tree]]:
    """A line of routed.rc: net, its driving pin, number of sinks, tree."""
    net, _, driver, count, *words = line.replace("(", " ( ").replace(")", " ) ").split()
    found, rest = _tree([word for word in words if word != ","])
    if rest:
        raise ValueError(f"routed.rc: {net}: unbalanced brackets")
    return net, (driver, int(count), found)


def _tree(words: list[str]) -> tuple[Tree, list[str]]:
    """Read "( ohm pF [pin] tree ... )"; return it and the rest of the words."""
    begin, ohm, capacitance, *rest = words
    if begin != "(":
        raise ValueError(f"routed.rc: {begin} instead of (")
    pin, inner = None, []
    while rest[0] != ")":
        if rest[0] == "(":
            each, rest = _tree(rest)
            inner.append(each)
        else:
            pin, *rest = rest
    return (float(ohm), float(capacitance), pin, inner), rest[1:]


def segments(tree: Tree) -> Iterator[tuple[int, int, float, float, str | None]]:
    """All segments of a tree: number of the parent's end and of its own (the driver is 0), ohm, pF
    and the pin at its end."""
    waiting, number = [(0, tree)], 0
    while waiting:
        parent, (ohm, capacitance, pin, inner) = waiting.pop()
        number += 1
        yield parent, number, ohm, capacitance, pin
        waiting += [(number, each) for each in inner]
