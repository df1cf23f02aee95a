"""A standard-cell library: cells, their areas, functions, delays.

What static timing needs of them: capacitance of pins, delays and slews as tables of slew and load
(NLDM), setup times. `sim.eda.liberty_file` reads the files.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

EDGES = ("rise", "fall")


@dataclass(frozen=True)
class Table:
    """Values by slew in ns (rows) and by load in pF (columns); of setup times by the clock's slew
    and the data's. Values in ns."""

    slews: np.ndarray
    loads: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Arc:
    """From a pin to another one. kind: of the liberty file, as rising_edge or setup_rising; ""
    for plain logic. sense: positive, negative, or "" for both. delays, slews: tables of the edges
    of the pin at its end, rise and fall, None where it has none."""

    begin: str
    end: str
    kind: str
    sense: str
    delays: tuple[Table | None, Table | None]
    slews: tuple[Table | None, Table | None]


@dataclass(frozen=True)
class Cell:
    """A cell. inputs: pF of each pin, rising and falling. functions: of each output. state: what
    its flip-flop says, attributes by name. special: not for synthesis to choose."""

    name: str
    area: float
    inputs: dict[str, tuple[float, float]]
    functions: dict[str, str]
    state: dict[str, str]
    arcs: tuple[Arc, ...]
    special: bool

    def computes(self, *truth: int) -> bool:
        """Whether it has one output, of that truth table."""
        if self.state or len(self.functions) != 1 or 2 ** len(self.inputs) != len(truth):
            return False
        (text,) = self.functions.values()
        return evaluated(text, list(self.inputs)) == list(truth)

    @property
    def is_flip_flop(self) -> bool:
        """A plain one at the rising edge: what it takes next is an input."""
        clock, data = (self.state.get(name, "") for name in ("clocked_on", "next_state"))
        return clock.strip("() ") in self.inputs and data.strip("() ") in self.inputs

    @property
    def clock(self) -> str:
        """A flip-flop's pin."""
        return self.state["clocked_on"].strip("() ")

    @property
    def data(self) -> str:
        """A flip-flop's pin."""
        return self.state["next_state"].strip("() ")


def evaluated(function: str, pins: list[str]) -> list[int]:
    """The truth table of a liberty function, its first pin counting slowest; empty if it has
    other names in it."""
    text = re.sub(r"(\w+|\([^()]*\))\s*'", r"~\1", function).replace("!", "~")
    text = re.sub(r"(?<=[\w)])\s+(?=[\w(~])", "&", text.strip())
    text = text.replace("*", "&").replace("+", "|")
    if not re.fullmatch(r"[\w~&|^() ]+", text) or set(re.findall(r"\w+", text)) - set(pins):
        return []
    code = compile(re.sub(r"\w+", lambda name: f"v{pins.index(name[0])}", text), "", "eval")
    rows = product((0, 1), repeat=len(pins))
    names = [f"v{k}" for k in range(len(pins))]
    return [eval(code, {"__builtins__": {}}, dict(zip(names, r, strict=True))) & 1 for r in rows]


@dataclass(frozen=True)
class Library:
    """A library of cells. text: the file's. corner: what it says of process, voltage and
    temperature."""

    name: str
    text: str
    corner: str
    cells: dict[str, Cell]

    def smallest(self, *truth: int) -> Cell | None:
        """The smallest cell of one output with that truth table."""
        found = (cell for cell in self.usable if cell.computes(*truth))
        return min(found, key=lambda cell: (cell.area, len(cell.name)), default=None)

    @cached_property
    def usable(self) -> list[Cell]:
        """Cells that synthesis may choose."""
        return [cell for cell in self.cells.values() if not cell.special and cell.area]

    @cached_property
    def nand2(self) -> Cell:
        return self.smallest(1, 1, 1, 0)

    @cached_property
    def inverter(self) -> Cell:
        return self.smallest(1, 0)

    @cached_property
    def driver(self) -> Cell:
        """The second buffer by area, or whatever there is that is most like it."""
        found = [cell for cell in self.usable if cell.computes(0, 1)] or [self.inverter]
        return sorted(found, key=lambda cell: cell.area)[min(1, len(found) - 1)]

    @cached_property
    def flip_flop(self) -> Cell:
        """The smallest one."""
        found = (cell for cell in self.usable if cell.is_flip_flop)
        return min(found, key=lambda cell: (cell.area, len(cell.name)), default=None)

    def left_out(self) -> list[str]:
        """Names of cells that synthesis shall not choose."""
        return [name for name, cell in self.cells.items() if cell.special]
