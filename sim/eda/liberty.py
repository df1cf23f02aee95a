"""A standard-cell library: cells, their areas, functions, delays, energies.

What static timing needs of them: capacitance of pins, delays and slews as tables of slew and load
(NLDM), setup times; and for power what a change takes inside of a cell, and leakage.
`sim.eda.liberty_file` reads the files.
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
    and the data's. Values in ns, of energies in pJ."""

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
class Inside:
    """What a change at a pin takes inside of its cell, but for the load's. begin: the input that
    makes an output change; "" for an input's own. energies: of its edges, rise and fall. condition:
    the state in which it is so, "" if in any."""

    begin: str
    pin: str
    energies: tuple[Table | None, Table | None]
    condition: str


@dataclass(frozen=True)
class Cell:
    """A cell. inputs: pF of each pin, rising and falling. functions: of each output. state: what
    its flip-flop says, attributes by name. special: not for synthesis to choose. leakage: W."""

    name: str
    area: float
    inputs: dict[str, tuple[float, float]]
    functions: dict[str, str]
    state: dict[str, str]
    arcs: tuple[Arc, ...]
    special: bool
    inside: tuple[Inside, ...]
    leakage: float

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

    def rests_in(self, condition: str) -> bool:
        """Whether a flip-flop may be in a state while its clock does not change it; True of one
        that is told by what is no pin."""
        pins = [*self.inputs, *self.functions]
        forced = [self.state[name] for name in ("clear", "preset") if name in self.state]
        tables = [evaluated(text, pins) for text in (condition or "1", *forced)]
        if not all(tables):
            return True
        for row, levels in enumerate(product((0, 1), repeat=len(pins))):
            held, *never = (table[row] for table in tables)
            level = dict(zip(pins, levels, strict=True))
            shown = (
                level[pin] == level[self.data] ^ (function != self.state["variable"])
                for pin, function in self.functions.items()
            )
            if held and not any(never) and all(shown):
                return True
        return False


def evaluated(function: str, pins: list[str]) -> list[int]:
    """The truth table of a liberty function, its first pin counting slowest; empty if it has
    other names in it."""
    text = re.sub(r"(\w+|\([^()]*\))\s*'", r"~\1", function).replace("!", "~")
    text = re.sub(r"(?<=[\w)])\s+(?=[\w(~])", "&", text.strip())
    text = text.replace("*", "&").replace("+", "|")
    known = {*pins, "0", "1"}
    if not re.fullmatch(r"[\w~&|^() ]+", text) or set(re.findall(r"\w+", text)) - known:
        return []
    variable = {pin: f"v{k}" for k, pin in enumerate(pins)}
    code = compile(re.sub(r"\w+", lambda name: variable.get(name[0], name[0]), text), "", "eval")
    rows = product((0, 1), repeat=len(pins))
    values = (dict(zip(variable.values(), row, strict=True)) for row in rows)
    return [eval(code, {"__builtins__": {}}, each) & 1 for each in values]


@dataclass(frozen=True)
class Library:
    """A library of cells. text: the file's. corner: what it says of process, voltage and
    temperature. voltage: V."""

    name: str
    text: str
    corner: str
    voltage: float
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
