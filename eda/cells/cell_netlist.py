"""A flat netlist of library cells and memories, assembled from separately mapped pieces."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from splatcore.eda.cells.liberty import Cell, Library
from splatcore.eda.cells.mapping import Mapped
from splatcore.eda.gates.macros import PORTS, PREFIX

CONSTANTS = {"0": 0, "1": 1, "x": 0, "z": 0}
"""Nets of constants; an undefined bit is 0."""

MEMORY = f"{PREFIX}_memory_"


@dataclass(frozen=True)
class Port:
    """A port of the netlist or of a memory. nets: one per bit."""

    name: str
    is_input: bool
    nets: np.ndarray


@dataclass(frozen=True)
class CellNetlist:
    """Cells of a library, by number, with the nets at their pins.

    kinds: [cells] index of each cell's kind in `library`'s cells
    pins: [cells, pins] nets of inputs and outputs in the library's order, padded with 0
    cells: names
    paths: of the pieces
    places: [cells] index of each cell's piece
    memories: path, module and ports of each memory
    names: of nets, by number
    nets: number of nets; nets 0 and 1 are constants
    """

    library: Library
    kinds: np.ndarray
    pins: np.ndarray
    cells: list[str]
    paths: list[str]
    places: np.ndarray
    ports: list[Port]
    memories: list[tuple[str, str, list[Port]]]
    names: dict[int, str]
    nets: int

    @cached_property
    def cell_kinds(self) -> list[Cell]:
        return list(self.library.cells.values())

    @property
    def areas(self) -> np.ndarray:
        """um² of each cell."""
        return np.array([cell.area for cell in self.cell_kinds])[self.kinds]

    @property
    def area(self) -> float:
        """Total area in um²."""
        return float(self.areas.sum())

    @property
    def is_flip_flop(self) -> np.ndarray:
        """[cells] whether each cell is of this kind."""
        return np.array([cell.is_flip_flop for cell in self.cell_kinds])[self.kinds]

    @property
    def is_clock_gate(self) -> np.ndarray:
        """[cells] whether each cell is of this kind."""
        return np.array([cell.is_clock_gate for cell in self.cell_kinds])[self.kinds]

    @property
    def gated(self) -> int:
        """Number of flip-flops behind clock gates."""
        behind = [np.zeros(0, np.int64)]
        clocks = [np.zeros(0, np.int64)]
        for cell, _, nets in self.by_kind():
            if cell.is_clock_gate:
                behind += [nets[pin] for pin in cell.functions]
            elif cell.is_flip_flop:
                clocks.append(nets[cell.clock])
        return int(np.isin(np.concatenate(clocks), np.concatenate(behind)).sum())

    @property
    def is_buffer(self) -> np.ndarray:
        """[cells] whether each cell is of this kind."""
        return np.array([cell.computes(0, 1) for cell in self.cell_kinds])[self.kinds]

    def by_kind(self):
        """For each kind of cell: the kind, the numbers of its cells, their nets by pin."""
        for kind in np.unique(self.kinds):
            cell, cells = self.cell_kinds[kind], np.flatnonzero(self.kinds == kind)
            columns = self.pins[cells].T
            yield cell, cells, dict(zip((*cell.inputs, *cell.functions), columns, strict=False))

    def port_names(self, *but: str) -> dict[bool, list[str]]:
        """Names of inputs (True) and outputs, without those in `but` (default: clock and reset)."""
        but = but or ("clk", "rst")
        return {
            is_input: [p.name for p in self.ports if p.is_input == is_input and p.name not in but]
            for is_input in (True, False)
        }

    def register(self, cell: int) -> str:
        """A flip-flop's name: the name of its first output net with a name."""
        kind = self.cell_kinds[self.kinds[cell]]
        outputs = self.pins[cell, len(kind.inputs) :][: len(kind.functions)]
        return self.name(next((net for net in outputs if int(net) in self.names), outputs[0]))

    def name(self, net: int) -> str:
        """A net's name in the source, else its number."""
        return self.names.get(int(net), f"net {net}")


def put_together(library: Library, pieces: Mapping[str, Mapped]) -> CellNetlist:
    """Assemble a netlist from pieces, by the paths of their instances; "" is the top.

    Each block of a piece that is not a memory must itself be a piece.
    """
    base, first = {}, 2  # each piece's bits begin after those of the previous piece
    for path, piece in pieces.items():
        base[path] = first
        first += 2 + max(
            (bit for bits in _all_bits(piece) for bit in bits if isinstance(bit, int)), default=0
        )

    def nets(path: str, bits: list) -> np.ndarray:
        found = [base[path] + b if isinstance(b, int) else CONSTANTS[b] for b in bits]
        return np.array(found, np.int64)

    net_of = _joined(pieces, nets, first)
    kinds = {name: number for number, name in enumerate(library.cells)}
    width = max(len(cell.inputs) + len(cell.functions) for cell in library.cells.values())
    rows = sum(len(piece.cells) for piece in pieces.values())
    found, pins = np.zeros(rows, np.int64), np.zeros((rows, width), np.int64)
    cells, names, memories, row = [], {}, [], 0
    for path, piece in pieces.items():
        dot = f"{path}." if path else ""
        for kind, name, bits in piece.cells:
            found[row], pins[row, : len(bits)] = kinds[kind], net_of[nets(path, bits)]
            cells.append(dot + name)
            row += 1
        for bit, name in piece.names.items():
            if bit.isdigit():
                names.setdefault(int(net_of[base[path] + int(bit)]), dot + name)
        for module, name, ports in piece.blocks:
            if module.startswith(MEMORY):
                found_ports = [
                    Port(port, port != PORTS[-1], net_of[nets(path, bits)])
                    for port, bits in zip(PORTS, ports, strict=True)
                ]
                memories.append((dot + plain(name), module, found_ports))
    counts = [len(piece.cells) for piece in pieces.values()]
    places = np.repeat(np.arange(len(counts)), counts)
    ports = [
        Port(name, direction == "input", net_of[nets("", bits)])
        for name, direction, bits in pieces[""].ports
    ]
    count = int(net_of.max()) + 1
    return CellNetlist(
        library, found, pins, cells, list(pieces), places, ports, memories, names, count
    )


def plain(name: str) -> str:
    """The path of an instance without the numbers that make its names unique."""
    return re.sub(r"\$\d+(?=\.|$)", "", name)


def _all_bits(piece: Mapped):
    """All lists of bits in a piece."""
    yield from (bits for _, _, bits in piece.cells)
    yield from (bits for _, _, ports in piece.blocks for bits in ports)
    yield from (bits for _, _, bits in piece.ports)
    yield [int(bit) for bit in piece.names if bit.isdigit()]


def _joined(pieces: Mapping[str, Mapped], nets, count: int) -> np.ndarray:
    """Number of the net in the whole netlist for each bit of each piece.

    Connected bits are one net; nets are numbered in the order of their first bits.
    """
    pairs = [np.zeros((2, 0), np.int64)]
    for path, piece in pieces.items():
        for module, name, ports in piece.blocks:
            if not module.startswith(MEMORY):
                inner = f"{path}.{plain(name)}" if path else plain(name)
                for bits, (_, _, own) in zip(ports, pieces[inner].ports, strict=True):
                    if bits:  # connected
                        pairs.append(np.stack([nets(path, bits), nets(inner, own)]))
    rows, columns = np.concatenate(pairs, axis=1)
    links = coo_array((np.ones(len(rows), np.int8), (rows, columns)), (count, count))
    _, label = connected_components(links, directed=False)
    _, first = np.unique(label, return_index=True)
    order = np.argsort(first)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return number[label]  # 0 and 1 come first, and stay
