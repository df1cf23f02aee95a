"""A standard-cell library: areas, functions, timing and power of its cells.

Timing: pin capacitances, delays and slews as tables of slew and load (NLDM), setup times. Power:
internal energy of changes, and leakage. `eda.cells.liberty_file` reads the files.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

EDGES = ("rise", "fall")


@dataclass(frozen=True)
class Table:
    """Values by slew in ns (rows) and load in pF (columns); setup times by the slews of clock and
    data, both in ns. Values are in ns, energies in pJ."""

    slews: np.ndarray
    loads: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Arc:
    """A timing arc.

    begin, end: pins
    kind: timing_type of the liberty file, such as rising_edge or setup_rising; "" for plain logic
    sense: positive, negative, or "" for both
    delays, slews: tables for a rising and a falling edge at `end`; None if it has no such edge
    """

    begin: str
    end: str
    kind: str
    sense: str
    delays: tuple[Table | None, Table | None]
    slews: tuple[Table | None, Table | None]


@dataclass(frozen=True)
class Inside:
    """Internal energy of a change at a pin, without the energy of the load.

    begin: the input that makes an output change; "" for changes of an input itself
    energies: tables for a rising and a falling edge
    condition: the state for which they hold; "" for any
    """

    begin: str
    pin: str
    energies: tuple[Table | None, Table | None]
    condition: str


@dataclass(frozen=True)
class Cell:
    """A cell.

    area: um²
    inputs: capacitance in pF of each pin, rising and falling
    functions: logic function of each output
    state: attributes of its flip-flop by name; empty for logic. A clock gate has its kind as
        `gate`, and its pins as `clocked_on` and `next_state` (the enable)
    special: whether synthesis must not choose it
    leakage: W
    """

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
        """Whether it is logic with one output of that truth table."""
        if self.state or len(self.functions) != 1 or 2 ** len(self.inputs) != len(truth):
            return False
        (text,) = self.functions.values()
        return evaluated(text, list(self.inputs)) == list(truth)

    @property
    def is_flip_flop(self) -> bool:
        """Whether it is a plain flip-flop: clocked by a rising edge, with an input pin as data."""
        clock, data = (self.state.get(name, "") for name in ("clocked_on", "next_state"))
        pins = {clock.strip("() "), data.strip("() ")}
        return pins <= self.inputs.keys() and "gate" not in self.state

    @property
    def is_clock_gate(self) -> bool:
        """Whether it passes on its clock while enabled: a latch, open while the clock is low, and
        an AND. Others have further inputs, for tests."""
        return self.state.get("gate") == "latch_posedge" and len(self.inputs) == 2

    @property
    def is_clocked(self) -> bool:
        """Whether it is a flip-flop or a clock gate."""
        return self.is_flip_flop or self.is_clock_gate

    @property
    def clock(self) -> str:
        """Clock pin of a flip-flop or clock gate."""
        return self.state["clocked_on"].strip("() ")

    @property
    def data(self) -> str:
        """Data pin of a flip-flop, or enable of a clock gate."""
        return self.state["next_state"].strip("() ")

    def rests_in(self, condition: str) -> bool:
        """Whether a flip-flop in a state may keep its value at the clock's edge.

        condition: the state, as a function of pins; True if it depends on other names
        """
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


def expression(function: str) -> str:
    """A liberty function with the operators ~ & ^ | of Python and Verilog."""
    text = re.sub(r"(\w+|\([^()]*\))\s*'", r"~\1", function).replace("!", "~")
    text = re.sub(r"(?<=[\w)])\s+(?=[\w(~])", "&", text.strip())
    return text.replace("*", "&").replace("+", "|")


def evaluated(function: str, pins: list[str]) -> list[int]:
    """Truth table of a liberty function; the first pin changes slowest. Empty if the function has
    names that are not pins."""
    text = expression(function)
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
    """A library of cells.

    text: contents of its file
    corner: process, voltage and temperature as text
    voltage: V
    capacitance: pF per unit of capacitance in its text
    gates_clocks: whether synthesis may choose its clock gates
    """

    name: str
    text: str
    corner: str
    voltage: float
    cells: dict[str, Cell]
    capacitance: float = 1.0
    gates_clocks: bool = True

    def smallest(self, *truth: int) -> Cell | None:
        """The smallest cell with one output of that truth table; None if there is none."""
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
        """The second-smallest buffer; the smallest if there is only one; an inverter if none."""
        found = [cell for cell in self.usable if cell.computes(0, 1)] or [self.inverter]
        return sorted(found, key=lambda cell: cell.area)[min(1, len(found) - 1)]

    @cached_property
    def flip_flop(self) -> Cell:
        """The smallest flip-flop."""
        found = (cell for cell in self.usable if cell.is_flip_flop)
        return min(found, key=lambda cell: (cell.area, len(cell.name)), default=None)

    @cached_property
    def clock_gate(self) -> Cell | None:
        """The smallest clock gate; None if there is none, or it may not be chosen."""
        found = (cell for cell in self.cells.values() if cell.is_clock_gate and self.gates_clocks)
        return min(found, key=lambda cell: cell.area, default=None)

    def left_out(self) -> list[str]:
        """Names of cells that synthesis must not choose."""
        return [name for name, cell in self.cells.items() if cell.special]
