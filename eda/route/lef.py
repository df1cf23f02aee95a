"""Layers of wires and sizes of cells, from LEF files."""

import re
from dataclasses import dataclass
from pathlib import Path

from splatcore.spec.error import InputError


@dataclass(frozen=True)
class Layer:
    """A layer of wires.

    pitch, width: µm
    horizontal: direction of its wires
    square: capacitance to the ground in pF per µm²
    edge: capacitance of each edge in pF per µm
    resistance: ohm per square
    """

    name: str
    pitch: float
    width: float
    horizontal: bool
    square: float
    edge: float
    resistance: float

    @property
    def capacitance(self) -> float:
        """pF per µm of wire: its area and, as LEF defines it, both of its edges."""
        return self.square * self.width + 2 * self.edge


@dataclass(frozen=True)
class Lef:
    """Facts of LEF files.

    paths: the files, technology first
    units: steps of the manufacturing grid per µm
    layers: from the lowest up
    sizes: µm of each cell, width and height
    filler: name of the narrowest cell without a signal pin
    """

    paths: tuple[Path, ...]
    units: int
    layers: tuple[Layer, ...]
    sizes: dict[str, tuple[float, float]]
    filler: str

    def capacitance(self, lengths: dict[str, float]) -> float:
        """pF of a net's wires. lengths: µm by layer."""
        return sum(lengths.get(layer.name, 0.0) * layer.capacitance for layer in self.layers)


LAYERS = 5
"""Layers of wires that are used; those above are wide, for power."""


def read_lef(files: str) -> Lef:
    """Read LEF files, separated by commas. Raises InputError, naming the file."""
    paths, texts = tuple(Path(name).absolute() for name in files.split(",")), []
    for path in paths:
        try:
            texts.append(re.sub(r"#.*", "", path.read_text()))
        except OSError as error:
            raise InputError(f"--lef {path}: {error.strerror}") from None
    text = "\n".join(texts)
    grid = re.search(r"MANUFACTURINGGRID\s+([\d.]+)", text)
    layers = [_layer(*found) for found in _blocks(text, "LAYER") if "ROUTING" in found[1].split()]
    cells = list(_blocks(text, "MACRO"))
    sizes = {name: _size(inside) for name, inside in cells}
    empty = [name for name, inside in cells if "USE SIGNAL" not in inside and sizes[name][0]]
    for missing, found in ("layers", grid and layers), ("cells", sizes), ("filler cells", empty):
        if not found:
            raise InputError(f"--lef {files}: has no {missing}")
    filler = min(empty, key=lambda name: sizes[name])
    return Lef(paths, round(1 / float(grid[1])), tuple(layers[:LAYERS]), sizes, filler)


def _blocks(text: str, kind: str):
    """Names and contents of all blocks of a kind."""
    yield from re.findall(rf"^{kind}\s+(\S+)\s*$(.*?)^END\s+\1\s*$", text, re.M | re.S)


def _layer(name: str, inside: str) -> Layer:
    def number(word: str) -> float:
        found = re.search(rf"^\s*{word}\s+([\d.eE+-]+)", inside, re.M)
        return float(found[1]) if found else 0.0

    horizontal = "HORIZONTAL" in inside.split()
    return Layer(
        name, number("PITCH"), number("WIDTH"), horizontal, number("CAPACITANCE\\s+CPERSQDIST"),
        number("EDGECAPACITANCE"), number("RESISTANCE\\s+RPERSQ"),
    )  # fmt: skip


def _size(inside: str) -> tuple[float, float]:
    found = re.search(r"^\s*SIZE\s+([\d.]+)\s+BY\s+([\d.]+)", inside, re.M)
    return (float(found[1]), float(found[2])) if found else (0.0, 0.0)
