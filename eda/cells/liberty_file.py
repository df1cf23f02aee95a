"""Liberty files (.lib, .lib.gz): parse groups and attributes, and build the library.

Noise, current-source models and hold times are skipped.
"""

import gzip
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from splatcore.eda.cells.liberty import EDGES, Arc, Cell, Inside, Library, Table
from splatcore.spec.error import InputError

COMMENT = re.compile(r"/\*.*?\*/|\\\r?\n", re.S)

STATEMENT = re.compile(
    r'(?P<name>\w+)\s*(?::\s*(?P<value>"[^"]*"|[^;{}\n]*)|'
    r'\((?P<arguments>(?:"[^"]*"|[^()"])*)\)\s*(?P<open>\{)?)|(?P<close>\})'
)
"""An attribute, the beginning of a group, or its end."""

WORD = re.compile(r'"([^"]*)"|([^\s,"]+)')

TIMES = {"fs": 1e-6, "ps": 1e-3, "ns": 1.0, "us": 1e3}
CAPACITANCES = {"ff": 1e-3, "pf": 1.0}
VOLTAGES = {"mv": 1e-3, "v": 1.0}
POWERS = {"pw": 1e-12, "nw": 1e-9, "uw": 1e-6, "mw": 1e-3}

SPECIAL = ("dont_use", "is_isolation_cell", "is_level_shifter", "always_on", "pad_cell")
"""Attributes of cells that synthesis must not choose."""


@dataclass
class Group:
    """A group of a liberty file.

    names: its arguments
    lines: attributes by name; a list of all arguments if they are in brackets
    """

    kind: str
    names: list[str]
    lines: dict[str, str | list[str]] = field(default_factory=dict)
    groups: list["Group"] = field(default_factory=list)

    def of_kind(self, *kinds: str) -> Iterator["Group"]:
        return (group for group in self.groups if group.kind in kinds)

    def number(self, name: str, default: float = 0.0) -> float:
        return float(self.lines.get(name, default))

    def numbers(self, name: str) -> np.ndarray:
        """All numbers in the strings of an attribute with brackets."""
        return np.array(" ".join(self.lines[name]).replace(",", " ").split(), float)


def parse(text: str) -> Group:
    """Parse a liberty text; its outermost group. Raises ValueError if it is not valid."""
    root = Group("", [])
    stack = [root]
    for found in STATEMENT.finditer(COMMENT.sub("", text)):
        if found["close"]:
            stack.pop()
        elif found["open"]:
            group = Group(found["name"], _words(found["arguments"]))
            stack[-1].groups.append(group)
            stack.append(group)
        elif found["value"] is not None:
            stack[-1].lines[found["name"]] = found["value"].strip().strip('"')
        else:
            stack[-1].lines[found["name"]] = _words(found["arguments"])
        if not stack:
            raise ValueError("one closing bracket too many")
    if len(stack) > 1 or [group.kind for group in root.groups] != ["library"]:
        raise ValueError("not a library" if len(stack) == 1 else "ends within a group")
    return root.groups[0]


def _words(text: str) -> list[str]:
    return [quoted or plain for quoted, plain in WORD.findall(text)]


class Reader:
    """Builds a library from its groups, in ns, pF and pJ."""

    def __init__(self, library: Group):
        self.group = library
        kinds = "lu_table_template", "power_lut_template"
        self.templates = {each.names[0]: each for each in library.of_kind(*kinds)}
        self.time = _unit(library.lines.get("time_unit", "1ns"), TIMES)
        factor, unit = library.lines.get("capacitive_load_unit", ["1", "pf"])
        self.capacitance = _unit(factor + unit, CAPACITANCES)
        # The unit of energy is implied: unit of capacitance times square of the unit of voltage.
        volts = _unit(library.lines.get("voltage_unit", "1V"), VOLTAGES)
        self.energy = self.capacitance * volts**2
        self.leakage = _unit(library.lines.get("leakage_power_unit", "1nW"), POWERS)
        if library.lines.get("delay_model", "table_lookup") != "table_lookup":
            raise ValueError(f"delay_model {library.lines['delay_model']} is not table_lookup")

    def library(self, text: str) -> Library:
        """Build the library. text: contents of the file."""
        cells = {group.names[0]: self.cell(group) for group in self.group.of_kind("cell")}
        voltage = self.group.number("nom_voltage")
        name, corner = self.group.names[0], self.corner()
        return Library(name, text, corner, voltage, cells, self.capacitance)

    def corner(self) -> str:
        """Process, voltage and temperature of the default operating conditions, as text."""
        name = self.group.lines.get("default_operating_conditions", "")
        found = {each.names[0]: each for each in self.group.of_kind("operating_conditions")}
        values = []
        for quantity, unit in {"process": "", "voltage": " V", "temperature": " °C"}.items():
            value = found[name].lines.get(quantity) if name in found else None
            value = value or self.group.lines.get(f"nom_{quantity}")
            if value is not None:
                values.append(f"{quantity} {float(value):g}{unit}")
        return ", ".join([name, *values] if name else values) or "unknown"

    def cell(self, group: Group) -> Cell:
        inputs, functions, arcs, inside = {}, {}, [], []
        for pin in group.of_kind("pin"):
            name = pin.names[0]
            if pin.lines.get("direction") == "input":
                inputs[name] = self.capacitances(pin)
            elif pin.lines.get("direction") == "output":
                functions[name] = pin.lines.get("function", "")
            arcs += [arc for timing in pin.of_kind("timing") for arc in self.arcs(name, timing)]
            for power in pin.of_kind("internal_power"):
                inside += self.inside(name, power)
        flip_flop = next(group.of_kind("ff"), Group("", []))
        other = next(group.of_kind("latch", "statetable", "ff_bank", "latch_bank"), None)
        special = any(group.lines.get(name) == "true" for name in SPECIAL)
        three_state = any("three_state" in pin.lines for pin in group.of_kind("pin"))
        return Cell(
            group.names[0], group.number("area"), inputs, functions,
            {name: str(value) for name, value in sorted(flip_flop.lines.items())}
            | ({"variable": flip_flop.names[0]} if flip_flop.names else {})
            | ({"other": other.kind} if other else {}) | self.clock_gate(group),
            tuple(arcs), special or three_state or "" in functions.values(), tuple(inside),
            self.leakage * group.number("cell_leakage_power"),
        )  # fmt: skip

    def clock_gate(self, group: Group) -> dict[str, str]:
        """State of a clock gate; empty for another cell."""
        if not (kind := group.lines.get("clock_gating_integrated_cell")):
            return {}
        names = {"clocked_on": "clock_gate_clock_pin", "next_state": "clock_gate_enable_pin"}
        return {"gate": kind} | {
            name: pin.names[0]
            for name, attribute in names.items()
            for pin in group.of_kind("pin") if pin.lines.get(attribute) == "true"
        }  # fmt: skip

    def capacitances(self, pin: Group) -> tuple[float, float]:
        both = pin.number("capacitance", self.group.number("default_input_pin_cap"))
        rise, fall = (pin.number(f"{edge}_capacitance", both) for edge in EDGES)
        return rise * self.capacitance, fall * self.capacitance

    def arcs(self, end: str, timing: Group) -> Iterator[Arc]:
        """Arcs to a pin, one per related pin of a timing group."""
        kind = timing.lines.get("timing_type", "").replace("combinational", "")
        if kind not in ("", "rising_edge", "setup_rising"):
            return
        names = ("{}_constraint",) if kind == "setup_rising" else ("cell_{}", "{}_transition")
        tables = [tuple(self.table(timing, name.format(edge)) for edge in EDGES) for name in names]
        sense = timing.lines.get("timing_sense", "").removesuffix("_unate").replace("non", "")
        for begin in timing.lines.get("related_pin", "").split():
            yield Arc(begin, end, kind, sense, tables[0], tables[-1])

    def inside(self, pin: str, power: Group) -> Iterator[Inside]:
        """Internal energies of changes at a pin, one per related pin of an internal_power group."""
        energies = tuple(self.table(power, f"{edge}_power", self.energy) for edge in EDGES)
        if not any(energies):
            energies = (self.table(power, "power", self.energy),) * 2
        for begin in power.lines.get("related_pin", "").split() or [""]:
            yield Inside(begin, pin, energies, power.lines.get("when", ""))

    def table(self, timing: Group, name: str, unit: float | None = None) -> Table | None:
        """Read a table by ns and pF; a missing axis means constant.

        unit: of the values; by default that of time
        """
        group = next(timing.of_kind(name), None)
        if group is None:
            return None
        values = group.numbers("values") * (self.time if unit is None else unit)
        template = self.templates.get(group.names[0], group)
        axes = {"slew": np.array([0.0]), "load": np.array([0.0])}
        order = []
        for number in (1, 2) if values.size > 1 else ():
            index, variable = f"index_{number}", template.lines.get(f"variable_{number}", "")
            if index in group.lines or index in template.lines:
                is_load = "capacitance" in variable or variable.startswith("constrained")
                unit = self.capacitance if "capacitance" in variable else self.time
                order.append("load" if is_load else "slew")
                source = group if index in group.lines else template
                axes[order[-1]] = source.numbers(index) * unit
        values = values.reshape([len(axes[each]) for each in order] or [1, 1])
        if order == ["load", "slew"]:
            values = values.T
        return Table(*axes.values(), values.reshape(len(axes["slew"]), len(axes["load"])))


def _unit(text: str, units: dict[str, float]) -> float:
    """Parse a factor with a unit, such as 100ps."""
    number, unit = re.fullmatch(r"([\d.e+-]+)\s*(\w+)", text.strip().lower()).groups()
    return float(number) * units[unit]


def read_liberty(path: str | Path) -> Library:
    """Read a library; InputError if it is not valid, or has no inverter, NAND2 or flip-flop."""
    try:
        data = Path(path).read_bytes()
        text = (gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data).decode()
        library = Reader(parse(text)).library(text)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except (ValueError, EOFError, zlib.error, KeyError) as error:
        raise InputError(f"{path}: not a liberty file, or damaged: {error}") from None
    wanted = {"inverter": "an inverter", "nand2": "a NAND2", "flip_flop": "a flip-flop"}
    for name, cell in wanted.items():
        if getattr(library, name) is None:
            raise InputError(f"{path}: the library has no cell that is {cell}")
    return library
