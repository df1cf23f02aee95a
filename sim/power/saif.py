"""Reading SAIF files (IEEE 1801-2018, annex I): changes of each net, and the time it is 0 and 1."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from splatcore.spec.error import InputError

NET = re.compile(r"\s*\((\S+) \(T0 (\d+)\) \(T1 (\d+)\) .*\(TC (\d+)\)\)\s*$")
INSTANCE = re.compile(r"\s*\(INSTANCE (\S+)")
DURATION = re.compile(r"\s*\(DURATION (\d+)\)")


class Net(NamedTuple):
    """A bit of a net. path: instances that it is in, from the outermost on; low, high: time that
    it was 0 and 1; changes: times that it rose or fell."""

    path: tuple[str, ...]
    name: str
    low: int
    high: int
    changes: int


def duration(path: Path) -> int:
    """Time that a file counted, in its own unit. InputError if it does not say."""
    with open(path) as file:
        found = next(filter(None, map(DURATION.match, file)), None)
    if found is None:
        raise InputError(f"{path}: has no DURATION, so it is no SAIF file")
    return int(found[1])


def nets(path: Path) -> Iterator[Net]:
    """All bits of all nets, as Verilator writes them: each on a line of its own.

    InputError if the file ends within an instance.
    """
    open_instances: list[tuple[int, str]] = []  # depth of parentheses around it, and its name
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
