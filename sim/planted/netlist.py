"""What a Verilog text of Amaranth's says, as far as `sim.planted.faults` needs it.

Assignments stand on a line of their own, with one operation or little more; always blocks are
indented by depth; a module is instantiated once.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

NAME = r"(?:\\\S+ |[A-Za-z_][\w$]*)"
LITERAL = r"\d+'s?[bdh][0-9a-fxz]+"
SYMBOL = r"<<<|>>>|&&|\|\||~\^|[=!]==?|[<>]=|<<|>>|\S"
TOKEN = re.compile(rf"(?:{LITERAL}|\$(?:un)?signed|{NAME}|\[[^\]]*\]|\d+|{SYMBOL})\s*")
"""Tokens of an expression, each with the space behind it; [a:b] is one."""

SELECT = re.compile(r"\[(\d+)(?::(\d+))?\]")

MODULE = re.compile(rf"module ({NAME})")
DECLARED = re.compile(rf"  (wire|reg|input|output) (?:\[(-?\d+):0\] )?({NAME})\s*(?:=.*)?;")
ASSIGN = re.compile(r"  assign (?P<target>.+?) = (?P<value>.+);")
STATEMENT = re.compile(r" {4,}(?P<target>.+?) (?P<how><?=) (?P<value>.+);")
IF = re.compile(r" {4,}(?:end )?(?:else )?if \((?P<value>.+)\)(?: begin)?")
INSTANCE = re.compile(rf"  ({NAME})\s*({NAME})\s*\(")
CONNECTION = re.compile(rf"    \.({NAME})\s*\((.*)\),?")

ALL = -1
"""Mask of a signal of which all bits are used, or of whose bits nothing is known."""

BITWISE = {"&", "|", "^", "~^"}
CARRYING = {"+", "-", "*"}
UNARY = {"~", "!", "-", *BITWISE}
OPERATORS = {"==", "!=", "<", "<=", ">", ">=", "<<", ">>", "<<<", ">>>", "&&", "||", "?"}
OPERATORS |= BITWISE | CARRYING | UNARY


class Item(NamedTuple):
    """A name in an expression, with its select if there is one."""

    first: int  # token
    last: int
    name: str
    low: int
    width: int | None  # not known, as of a memory's row
    address: bool = False  # it stands within a select


class Expression:
    """An expression of a module: its tokens, and as they stand with the space behind them."""

    def __init__(self, module: "Module", value: str):
        self.module, self.value = module, value
        self.standing = TOKEN.findall(value)
        self.tokens = [token.strip() for token in self.standing]

    def text(self, first: int, last: int | None = None) -> str:
        """What stands from one token up to another."""
        return "".join(self.standing[first:last])

    def changed(self, k: int, token: str) -> str:
        """The expression with another token at k."""
        old = self.standing[k]
        token += old[len(old.rstrip()) :] if token else ""
        return "".join([*self.standing[:k], token, *self.standing[k + 1 :]])

    def unary(self, k: int) -> bool:
        """Whether the operator at k has no left operand."""
        return k == 0 or self.tokens[k - 1] in OPERATORS | set("({,:")

    @cached_property
    def items(self) -> list[Item]:
        found = []
        for k, token in enumerate(self.tokens):
            if not re.fullmatch(r"\\\S+|[A-Za-z_][\w$]*", token):
                continue
            behind = self.tokens[k + 1] if k + 1 < len(self.tokens) else ""
            if match := SELECT.fullmatch(behind):
                low = int(match[2] or match[1])
                found.append(Item(k, k + 1, token, low, int(match[1]) - low + 1))
            elif behind.startswith("["):
                found.append(Item(k, k + 1, token, 0, None))
                inner = Expression(self.module, behind[1:-1])
                found += [Item(k, k + 1, item.name, 0, None, True) for item in inner.items]
            else:
                found.append(Item(k, k, token, 0, self.module.widths.get(token)))
        return found

    def width(self, first: int = 0, last: int | None = None) -> int:
        """Bits of all names and literals from one token up to another."""
        last = len(self.tokens) if last is None else last
        bits = sum(item.width or 0 for item in self.items if first <= item.first < last)
        literals = [t for t in self.tokens[first:last] if re.fullmatch(LITERAL, t)]
        return bits + sum(int(token.split("'")[0]) for token in literals)

    def needed(self, first: int, last: int, live: int) -> int:
        """Mask of the bits of some tokens, beside each other, that the value's `live` bits need."""
        ones = (1 << self.width(first, last + 1)) - 1
        way = self._way(first)
        if live == ALL or way == "all":
            return ones
        position = 0
        if self.tokens[:first].count("{") > self.tokens[:first].count("}"):
            position = self.width(last + 1, self.tokens.index("}", last))
        if way == "carried":
            return ones & (1 << max(live.bit_length() - position, 0)) - 1
        return live >> position & ones

    def _way(self, first: int) -> str:
        """How a token's bits get into the value: "straight", "carried" upward, or "all" to all."""
        unary, binary = self._operators
        if "?" in binary:
            straight = first > self.tokens.index("?")
        else:
            straight = unary <= {"~"} and binary <= BITWISE
        if straight and "$signed" not in self.tokens:
            return "straight"
        return "carried" if unary | binary <= CARRYING and binary else "all"

    @cached_property
    def _operators(self) -> tuple[set[str], set[str]]:
        """The unary and the binary operators outside of parentheses and braces."""
        found, depth = (set(), set()), 0
        for k, token in enumerate(self.tokens):
            depth += (token in ("(", "{")) - (token in (")", "}"))
            if depth == 0 and token in OPERATORS:
                found[not self.unary(k)].add(token)
        return found


class Place(NamedTuple):
    """A value that is given to a target, or a condition, on a line."""

    line: int
    target: str  # empty for a condition
    value: str
    inside: tuple[str, ...] = ()  # the conditions around it


@dataclass
class Block:
    """An assignment or an always block. watched: what it depends on as a whole."""

    places: list[Place] = field(default_factory=list)
    watched: list[str] = field(default_factory=list)
    asserts: bool = False


@dataclass
class Module:
    name: str
    widths: dict[str, int] = field(default_factory=dict)
    outputs: set[str] = field(default_factory=set)
    constants: dict[str, str] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    children: list[tuple[str, str, str]] = field(default_factory=list)  # module, port, connected

    def truth(self, condition: str) -> bool | None:
        """What a condition always is, if that is plain to see."""
        literal = self.constants.get(condition.strip(), "")
        return int(literal.split("'h")[1], 16) != 0 if "'h" in literal else None


def modules(lines: list[str]) -> list[Module]:
    """The modules of a Verilog text, by its lines."""
    found = []
    block, child, inside = None, None, []
    for number, line in enumerate(lines):
        if block and line.startswith("    "):
            _always_line(block, number, line, inside)
            continue
        block = None
        if match := MODULE.match(line):
            found.append(Module(match[1].strip()))
        elif match := DECLARED.match(line):
            found[-1].widths[match[3].strip()] = int(match[2] or 0) + 1
            if match[1] == "output":
                found[-1].outputs.add(match[3].strip())
        elif match := ASSIGN.match(line):
            place = Place(number, match["target"], match["value"])
            found[-1].blocks.append(Block([place]))
            if re.fullmatch(LITERAL, place.value):
                found[-1].constants[place.target.strip()] = place.value
        elif line.startswith("  always"):
            block, inside = Block(), []
            found[-1].blocks.append(block)
        elif match := INSTANCE.match(line):
            child = match[1].strip()
        elif match := CONNECTION.match(line):
            found[-1].children.append((child, match[1] + " ", match[2]))
    return found


def _always_line(block: Block, number: int, line: str, inside: list[str]) -> None:
    """Add a line of an always block. inside: the conditions around it, which it may change."""
    depth = (len(line) - len(line.lstrip())) // 2 - 2
    del inside[depth:]
    around = tuple(inside)
    if match := IF.fullmatch(line):
        inside += [""] * (depth - len(inside)) + [match["value"]]
        block.watched.append(match["value"])
        block.places.append(Place(number, "", match["value"], around))
    elif match := STATEMENT.fullmatch(line):
        block.places.append(Place(number, match["target"], match["value"], around))
    else:
        block.watched.append(line)
        block.asserts |= "assert" in line or "cover" in line


class Used:
    """The bits that the outputs of a text's first module depend on."""

    def __init__(self, found: list[Module]):
        self.masks: dict[tuple[str, str], int] = defaultdict(int)  # by module and signal
        self._drivers = defaultdict(list)
        self._changed: list[tuple[str, str]] = []
        by_name = {module.name: module for module in found}
        for module in found:
            for block in module.blocks:
                for place in block.places:
                    self._drive(module, place.target, module, place.value, block)
            for name, port, connected in module.children:
                child = by_name[name]
                if port.strip() in child.outputs:
                    self._drive(module, connected, child, port)
                else:
                    self._drive(child, port, module, connected)
            for block in module.blocks:
                if block.asserts:
                    self._watch(module, block)
        for name in found[0].outputs:
            self._need(found[0], name, ALL)
        while self._changed:
            for driver in self._drivers[self._changed.pop()]:
                self._follow(*driver)

    def live(self, target: Expression) -> int:
        """Mask of the bits of what is assigned to a target that are used; 1 for a condition."""
        items = [item for item in target.items if not item.address]
        if len(items) != 1:
            return ALL if items else 1
        mask = self.masks[target.module.name, items[0].name]
        if items[0].width is None:
            return mask
        return mask >> items[0].low & (1 << items[0].width) - 1

    def alive(self, module: Module, block: Block) -> bool:
        """Whether anything depends on a block."""
        targets = [Expression(module, place.target) for place in block.places if place.target]
        return block.asserts or any(self.live(target) for target in targets)

    def _drive(self, module: Module, target: str, source: Module, value: str, block=None) -> None:
        target = Expression(module, target)
        for item in target.items:
            driver = (target, Expression(source, value), block)
            self._drivers[module.name, item.name].append(driver)

    def _follow(self, target: Expression, value: Expression, block: Block | None) -> None:
        live = self.live(target)
        if live == 0:
            return
        for item in value.items:
            needed = ALL if item.width is None else value.needed(item.first, item.last, live)
            self._need(value.module, item.name, needed << item.low)
        if block:
            self._watch(value.module, block)
        for item in target.items:
            if item.address:
                self._need(target.module, item.name, ALL)

    def _watch(self, module: Module, block: Block) -> None:
        for text in block.watched:
            for item in Expression(module, text).items:
                self._need(module, item.name, ALL)

    def _need(self, module: Module, name: str, mask: int) -> None:
        before = self.masks[module.name, name]
        self.masks[module.name, name] = before | mask
        if before | mask != before:
            self._changed.append((module.name, name))
