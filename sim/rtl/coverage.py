"""Coverage: which arms of the conditions in hdl/ were taken in simulation.

With the environment variable `FOLDER` set to a folder, simulations save there how often each arm of
their Verilog was taken: of if, else, case and conditional expressions. Amaranth's attributes name
the line of hdl/ of each statement. An arm counts as taken if any simulation takes it in any
instance of its component.
"""

import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

FOLDER = "SPLATCORE_COVERAGE"
"""Environment variable: folder in which each simulation saves its counts."""

COUNTING = ("--coverage-line",)
"""Verilator's arguments for a program with counters."""

ARMS = {
    "if": "taken", "else": "not taken", "elsif": "taken", "case": "case",
    "cond_then": "first", "cond_else": "second",
}  # fmt: skip
"""Our names of arms by Verilator's; its other names are blocks without a condition."""

MODULE = re.compile(r"^module (\S+)")
SOURCE = re.compile(r'src = "[^"]*?/(hdl/[^":|]+):(\d+)')
CLOCKED = re.compile(r"^    (\S+) ?(?:\[[^]]*\])? <= (\S+?) ?;$")
ASSIGNED = re.compile(r"^  assign (\S+) ?(?:\[[^]]*\])? = ")
TARGET = re.compile(r"^ +(\S+) ?(?:\[[^]]*\] )? ?= ")
CONDITION = re.compile(r"if \((\S+?) ?(?:\[[^]]*\] ?)?\)")
UNNAMED = re.compile(r"\$\d+$")


class Place(NamedTuple):
    """A line of a file in hdl/. file: path in the repository."""

    file: str
    line: int

    def __str__(self):
        return f"{self.file}:{self.line}"


class Arm(NamedTuple):
    """An arm of a condition.

    place: line of the condition, or of the signal that it sets
    target: name of that signal
    arm: description of the arm
    """

    place: Place
    target: str
    arm: str


@dataclass
class Module:
    """A module of Verilog. places: lines of hdl/ by signal; registers: by unnamed signal, the
    register that takes its value at the next clock edge."""

    places: dict[str, Place] = field(default_factory=dict)
    registers: dict[str, str] = field(default_factory=dict)


def counted() -> bool:
    """Whether simulations count which arms are taken."""
    return bool(os.environ.get(FOLDER))


def arms(folder: Path) -> Counter[Arm]:
    """Count how often each arm was taken, over all simulations that saved counts in a folder."""
    found: Counter[Arm] = Counter()
    known: dict[Path, list[Arm | None]] = {}
    for path in sorted(folder.glob("*.dat")):
        source = Path(path.with_suffix(".program").read_text()).parents[1] / "top.sv"
        if source not in known:
            known[source] = described(source.read_text().splitlines())
        places = known[source]
        for line, name, count in points(path):
            if name in ARMS and (arm := places[line - 1]):
                found[arm._replace(arm=arm.arm.format(ARMS[name]))] += count
    return found


def points(path: Path) -> Iterator[tuple[int, str, int]]:
    """Line, name and count of each point in a data file of Verilator's."""
    for text in path.read_text(errors="replace").splitlines():
        if text.startswith("C '"):
            fields, count = text[3:].rsplit("' ", 1)
            values = dict(part.split("\x02", 1) for part in fields.strip("\x01").split("\x01"))
            yield int(values["l"]), values.get("o", ""), int(count)


def described(lines: list[str]) -> list[Arm | None]:
    """For each line of Verilog, the arm in hdl/ that its condition comes from, if any."""
    found: list[Arm | None] = []
    for begin, end in _modules(lines):
        module = _module(lines[begin:end])
        found += [None] * (begin - len(found))
        target = switch = ""
        for line in lines[begin:end]:
            if line.startswith("  always"):
                target = switch = ""
            elif not target and (match := TARGET.match(line)):
                target = module.registers.get(match[1], match[1])
            if "casez (" in line:
                switch = line.split("(", 1)[1].split(")")[0].strip()
            found.append(_arm(module, line, target, switch))
    return found + [None] * (len(lines) - len(found))


def _modules(lines: list[str]) -> Iterator[tuple[int, int]]:
    """Range of lines of each module: first, and last + 1."""
    begin = 0
    for number, line in enumerate(lines):
        if MODULE.match(line):
            begin = number
        elif line == "endmodule":
            yield begin, number + 1


def _module(lines: list[str]) -> Module:
    """Find the source lines of a module's signals, and its registers."""
    module, before = Module(), None
    for line in lines:
        match = SOURCE.search(line)
        place = Place(match[1], int(match[2])) if match else None
        if line.startswith("  (*"):
            before = place
            continue
        if (assigned := ASSIGNED.match(line)) and place:
            module.places[assigned[1]] = place
        elif line.startswith(("  reg ", "  wire ")) and before:
            module.places.setdefault(line.split(" = ")[0].rstrip(" ;").split()[-1], before)
        elif clocked := CLOCKED.match(line):
            module.registers[clocked[2]] = clocked[1]
        if not line.startswith("  always"):
            before = None
    return module


def _arm(module: Module, line: str, target: str, switch: str) -> Arm | None:
    """The arm of a line, with a placeholder for which arm it is."""
    place, name = module.places.get(target), _plain(target)
    if " ? " in line:
        match = SOURCE.search(line)
        name = match and _plain(line.split(" = ")[0].split()[-1])
        return Arm(Place(match[1], int(match[2])), name, "{} of two values") if match else None
    if match := CONDITION.search(line):
        if "verilog_backend" in line:
            return None
        place = module.places.get(match[1], place) if UNNAMED.search(match[1]) else place
        return place and Arm(place, name, f"if {_plain(match[1]) or 'so'} {{}}")
    if switch and place and line.rstrip().endswith(":"):
        return Arm(place, name, f"{_plain(switch)} {line.strip().rstrip(':')} {{}}")
    return None


def _plain(name: str) -> str:
    """A signal's name in Amaranth; empty if it has none."""
    return "" if UNNAMED.fullmatch(name.lstrip("\\")) else name.lstrip("\\").split("$")[0]
