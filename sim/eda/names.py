"""Readable names in generated Verilog: plain identifiers, and a line of Python in most others.

Amaranth gives expressions no name, and nets of one name a number: `\\$313`, `\\area$240.groups`,
which have to be escaped and say nothing. Here the first becomes `frame_py_138_313`, number 313,
made by line 138 of a file frame.py; what a register takes next is `area_next`,
what a signal is `area_value`; the second is `area_240__groups`, as ports have their fields.
"""

import re

from splatcore.sim.rtl.convert import MODULE

ESCAPED = re.compile(r"\\(\S+) ")
NUMBER = re.compile(r"\$\d+")
NAMELESS = re.compile(r"\\(\$\d+) ")

ASSIGNED = re.compile(r"^ +(?:assign )?\\(\$\d+) +<?= (.*);$", re.M)
"""A net without a name that is given a value; the expression. A block does that in many lines."""

TAKEN = re.compile(r"^ +(?:if \(.*\) |assign )?(?:\\(\S+) |(\w+)) *(<?)= \\(\$\d+) ;$", re.M)
"""A signal, escaped or plain, that is a net without a name, or a register that takes it (<)."""

SOURCE = re.compile(r'\(\* src = "([^":|]*)[^"]*?:(\d+)[^"]*" \*\)')

ATTRIBUTE = re.compile(r'^ *\(\* src = "[^"]*" \*\)\n|\(\* src = "[^"]*" \*\) ?', re.M)

PART = re.compile(r"^(?:\\(\S+) |(\w+) ?)\[(\d+)(?::(\d+))?\]$")
"""An expression that is a part of a signal, escaped or plain: its bits."""

BLOCK = re.compile(r"^  always @\*.*?^  end$", re.M | re.S)

PATHS = re.compile(r'(?<=src = ")[^"]+(?=")')
PLACE = re.compile(r".*/site-packages/|[^|]*/(?=(?:spec|hdl|sim)/[^|]*$)|.*/")
"""What comes before a file of this project or of a library, or before any other file's name."""


def readable(text: str) -> str:
    """Verilog with `src` attributes: its nets have plain names, and their paths no folder of the
    machine on which it was made."""
    text = PATHS.sub(lambda found: _places(found[0]), text)
    taken = set(re.findall(r"\w+", text))
    plain: dict[str, str] = {}

    def rename(found: re.Match) -> str:
        if found[1] not in plain:
            name = _identifier(found[1])
            while name in taken:
                name += "_"
            taken.add(name)
            plain[found[1]] = name
        return f"{plain[found[1]]} "

    text = MODULE.sub(lambda module: _named(module[0], taken), text)
    return ESCAPED.sub(rename, text)


def without_source(text: str) -> str:
    """Verilog without `src` attributes."""
    return ATTRIBUTE.sub("", text)


def _identifier(name: str) -> str:
    """An escaped name as a plain one: numbers at its end, nothing that Verilog has a use for."""
    if re.fullmatch(r"\w+", name):
        return f"{name}_"
    number = re.match(r"\$(\d+)(.+)", name)
    name = f"{number[2]}_{number[1]}" if number else name
    name = re.sub(r"\W", "_", name.replace(".", "__")).lstrip("_")
    return f"n{name}" if name[0].isdigit() else name


def _places(paths: str) -> str:
    """Files and lines of an attribute, without the folders of the machine that made it."""
    return "|".join(PLACE.sub("", path, count=1) for path in paths.split("|"))


def _line(found: re.Match, net: str) -> str:
    """The name of a net after the line that made it."""
    file = found[1].rpartition("/")[2].replace(".", "_")
    return f"{file}_{found[2]}_{net[1:]}"


def _named(module: str, taken: set[str]) -> str:
    """A module whose nets without names are called after the signal that they are for, else
    after the line that made them."""
    names: dict[str, str] = {}
    used = set(taken)

    def give(net: str, name: str):
        if net not in names and name not in used:
            used.add(name)
            names[net] = name

    for escaped, signal, register, net in TAKEN.findall(module):
        if not NUMBER.fullmatch(escaped):
            name = signal or _identifier(escaped)
            give(net, f"{name}_next" if register else f"{name}_value")
    for net, expression in ASSIGNED.findall(module):
        if found := SOURCE.search(expression):
            give(net, _line(found, net))
        elif (part := PART.match(expression)) and not NUMBER.fullmatch(part[1] or ""):
            signal = _identifier(part[1]) if part[1] else part[2]
            give(net, "_".join([signal, *(bit for bit in part.groups()[2:] if bit), net[1:]]))
    for block in BLOCK.findall(module):
        if found := SOURCE.search(block):
            for net, _ in ASSIGNED.findall(block):
                give(net, _line(found, net))
    return NAMELESS.sub(lambda found: f"{names.get(found[1], f'net_{found[1][1:]}')} ", module)
