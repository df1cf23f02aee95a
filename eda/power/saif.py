"""Reader of SAIF files (IEEE 1801-2018, annex I): changes of each net, and its time at 0 and 1."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from splatcore.spec.error import InputError

NET = re.compile(r"\s*\((\S+) \(T0 (\d+)\) \(T1 (\d+)\) .*\(TC (\d+)\)\)\s*$")
INSTANCE = re.compile(r"\s*\(INSTANCE (\S+)")
DURATION = re.compile(r"\s*\(DURATION (\d+)\)")


class Net(NamedTuple):
    """One bit of a net.

    path: instances around it, outermost first
    low, high: time at 0 and at 1
    changes: rising and falling edges
    """

    path: tuple[str, ...]
    name: str
    low: int
    high: int
    changes: int


def duration(path: Path) -> int:
    """Time that a file covers, in its own unit. Raises InputError if the file has no duration."""
    with open(path) as file:
        found = next(filter(None, map(DURATION.match, file)), None)
    if found is None:
        raise InputError(f"{path}: has no DURATION; not a SAIF file")
    return int(found[1])


def nets(path: Path) -> Iterator[Net]:
    """Yield all bits of all nets, which Verilator writes on one line each.

    Raises InputError if the file ends within an instance.
    """
    open_instances: list[tuple[int, str]] = []  # depth of parentheses around each, and its name
    depth, names = 0, ()
    with open(path) as file:
        for line in file:
            if found := NET.match(line):
                yield Net(names, found[1].replace("\\", ""), *map(int, found.group(2, 3, 4)))
                continue
            if found := INSTANCE.match(line):
                open_instances.append((depth, found[1]))
            depth += line.count("(") - line.count(")")
            while open_instances and depth <= open_instances[-1][0]:
                open_instances.pop()
            names = tuple(name for _, name in open_instances)
    if depth:
        raise InputError(f"{path}: ends within an instance")
