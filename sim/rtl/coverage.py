"""Which arms of the hardware's conditions simulations take: Verilator counts, files of hdl/ tell.

With the environment variable `FOLDER` set to a folder, simulations count, and leave there how
often each arm of their Verilog was taken: of if, else, case and of what chooses between two values.
Amaranth writes from which line of hdl/ a statement is. An arm counts as taken if it is in one of
all instances of a part, in one of the simulations.
"""

import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

FOLDER = "SPLATCORE_COVERAGE"
"""Environment variable: a folder in which each simulation leaves what of its Verilog it reached."""

COUNTING = ("--coverage-line",)
"""Verilator's arguments for a program that counts."""

ARMS = {
    "if": "taken", "else": "not taken", "elsif": "taken", "case": "case",
    "cond_then": "first", "cond_else": "second",
}  # fmt: skip
"""Verilator's names of arms, and ours; others are blocks without a condition."""

MODULE = re.compile(r"^module (\S+)")
SOURCE = re.compile(r'src = "[^"]*?/(hdl/[^":|]+):(\d+)')
CLOCKED = re.compile(r"^    (\S+) ?(?:\[[^]]*\])? <= (\S+?) ?;$")
ASSIGNED = re.compile(r"^  assign (\S+) ?(?:\[[^]]*\])? = ")
TARGET = re.compile(r"^ +(\S+) ?(?:\[[^]]*\] )? ?= ")
CONDITION = re.compile(r"if \((\S+?) ?(?:\[[^]]*\] ?)?\)")
UNNAMED = re.compile(r"\$\d+$")


class Place(NamedTuple):
    """A line of a file of hdl/, by its path in the repository."""

    file: str
    line: int

    def __str__(self):
        return f"{self.file}:{self.line}"


class Arm(NamedTuple):
    """An arm of a condition. place: of the condition, or else of what it sets; target: what that
    is; arm: which one, in words."""

    place: Place
    target: str
    arm: str


@dataclass
class Module:
    """What the lines of a module of Verilog tell. places: of signals; registers: what an unnamed
    signal becomes at the next clock edge."""

    places: dict[str, Place] = field(default_factory=dict)
    registers: dict[str, str] = field(default_factory=dict)


def counted() -> bool:
    """Whether simulations are to count which arms are taken."""
    return bool(os.environ.get(FOLDER))


def arms(folder: Path) -> Counter[Arm]:
    """How often each arm was taken in the simulations that left their counts in a folder."""
    found: Counter[Arm] = Counter()
    known: dict[Path, list[Arm | None]] = {}
    for path in sorted(folder.glob("*.dat")):
        source = Path(path.with_suffix(".program").read_text()).parents[1] / "top.sv"
        if source not in known:
            known[source] = described(source.read_text().splitlines())
        places = known[source]
        for line, name, count in points(path):
            if name in ARMS and (where := places[line - 1]):
                found[where._replace(arm=where.arm.format(ARMS[name]))] += count
    return found


def points(path: Path) -> Iterator[tuple[int, str, int]]:
    """Line, name and count of each point of a file of Verilator's."""
    for text in path.read_text(errors="replace").splitlines():
        if text.startswith("C '"):
            fields, count = text[3:].rsplit("' ", 1)
            values = dict(part.split("\x02", 1) for part in fields.strip("\x01").split("\x01"))
            yield int(values["l"]), values.get("o", ""), int(count)


def described(lines: list[str]) -> list[Arm | None]:
    """Of each line of Verilog the arm that a condition in it stands for, if one of hdl/ does."""
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
    """First line of each module, and the one behind its last."""
    begin = 0
    for number, line in enumerate(lines):
        if MODULE.match(line):
            begin = number
        elif line == "endmodule":
            yield begin, number + 1


def _module(lines: list[str]) -> Module:
    """Where the signals of a module are made, and what they become."""
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
    """The arm of a line, with a gap for which one it is."""
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
    """A signal's name in Amaranth; nothing for one without."""
    return "" if UNNAMED.fullmatch(name.lstrip("\\")) else name.lstrip("\\").split("$")[0]
