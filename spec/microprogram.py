"""Microprograms: the syntax of their lines, and a program's steps and names.

A line `name = …` computes one value, once. Products and sums run on the processing elements (PEs),
each a multiplier followed by an adder, which both round; either can be bypassed:

    a * b        a * b + c        c - a * b        a + c        c - a

A sum of several products is a step for each, from the left: `x = a * b + c * d - e * f` computes
x0 = a * b, x1 = c * d + x0 and x = x1 - e * f. The other steps have units of their own, one of
each:

    reciprocal(a)     1/a
    rsqrt(a)          1/√a
    clamp(a, limit)   a within ± limit
    maximum(a, b)     the larger one
    product(a, b)     and the other units of `spec.compensation`, which are no floats of the
                      arithmetic

A name that no line computes is an input: one of `CONSTANTS`, which stay for a frame, or a field
that comes with each item. Values are floats of `Config.arithmetic`; the cull programs have the
finer floats of `spec.depth.finer`. A line must stand after the lines that compute its operands;
`spec.schedule` decides when each step runs. The programs are in `spec.programs`.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from splatcore.spec.compensation import MODEL_CONSTANTS
from splatcore.spec.config import Config
from splatcore.spec.programs import (
    BASIS_CONSTANTS,
    CONSTANTS,
    LEVEL_CONSTANTS,
    PROJECTIONS,
    SQUARE_CONSTANTS,
    TEXTS,
)

COMPENSATION_UNITS = ("product", "minor", "log", "log_sum", "fade")
"""Units of machines that compensate opacities (`spec.compensation`)."""

UNITS = ("pe", "reciprocal", "rsqrt", "clamp", "maximum", *COMPENSATION_UNITS)
"""Units on which steps run."""

PATTERNS = (
    (r"(?P<a>\w+) \* (?P<b>\w+)", "pe", False),
    (r"(?P<a>\w+) \* (?P<b>\w+) \+ (?P<c>\w+)", "pe", False),
    (r"(?P<c>\w+) - (?P<a>\w+) \* (?P<b>\w+)", "pe", True),
    (r"(?P<a>\w+) \+ (?P<c>\w+)", "pe", False),
    (r"(?P<c>\w+) - (?P<a>\w+)", "pe", True),
    (r"(?P<unit>\w+)\((?P<a>\w+)(, (?P<b>\w+))?\)", None, False),
    (r"(?P<unit>minor)\((?P<a>\w+), (?P<b>\w+), (?P<c>\w+)\)", None, False),
)
"""Syntax of the right side of a line, its unit, and whether the product is subtracted."""


@dataclass(frozen=True)
class Step:
    """One line: `name = c ± a·b` on a PE, or `name = unit(a, b)`; absent operands are None."""

    name: str
    unit: str
    a: str
    b: str | None = None
    c: str | None = None
    negate: bool = False  # subtract the product

    def __str__(self) -> str:
        """Return the line of this step."""
        if self.unit != "pe":
            return f"{self.name} = {self.unit}({', '.join(self.operands)})"
        product = f"{self.a} * {self.b}" if self.b else self.a
        if self.c is None:
            return f"{self.name} = {product}"
        both = f"{self.c} - {product}" if self.negate else f"{product} + {self.c}"
        return f"{self.name} = {both}"

    @property
    def operands(self) -> tuple[str, ...]:
        return tuple(operand for operand in (self.a, self.b, self.c) if operand)

    @property
    def operations(self) -> dict[str, int]:
        """Multiplications, additions, reciprocals … of the step, counted as in the paper."""
        if self.unit != "pe":
            return {self.unit: 1}
        return {"multiply": int(self.b is not None), "add": int(self.c is not None)}


def parse(text: str) -> tuple[Step, ...]:
    """Return the steps of a program; raise ValueError, with the line, for any other syntax."""
    steps: dict[str, Step] = {}
    for number, line in enumerate(text.splitlines(), 1):
        line = line.partition("#")[0].strip()
        for name, right in _products(line) if line else ():
            step = _step(name, right)
            if step is None or name in steps:
                raise ValueError(f"microprogram line {number}: '{line}'")
            steps[name] = step
    return tuple(steps.values())


def _products(line: str) -> Iterator[tuple[str, str]]:
    """Yield names and right sides of a line's steps: one for each product of a sum."""
    name, _, right = line.partition(" = ")
    total, *others = re.split(r" (?=[+-] \w+ \* )", right)
    if " * " not in total:  # c - a * b
        total, others = right, []
    for k, term in enumerate(others):
        yield f"{name}{k}", total
        sign, product = term.split(" ", 1)
        total = f"{product} + {name}{k}" if sign == "+" else f"{name}{k} - {product}"
    yield name, total


def _step(name: str, right: str) -> Step | None:
    """Return the step of a right side with one operation, or None."""
    for pattern, unit, negate in PATTERNS:
        if match := re.fullmatch(pattern, right):
            found = {key: value for key, value in match.groupdict().items() if value}
            step = Step(name, **({"unit": unit} | found), negate=negate)
            return step if step.unit in UNITS else None
    return None


@dataclass(frozen=True)
class Program:
    """A program's steps and names."""

    name: str
    steps: tuple[Step, ...]
    outputs: tuple[str, ...]  # names of the values that it returns

    @property
    def made(self) -> set[str]:
        """Names of the values that its steps compute."""
        return {step.name for step in self.steps}

    @property
    def inputs(self) -> tuple[str, ...]:
        """Operands that no step computes, in the order of their first use."""
        read = [operand for step in self.steps for operand in step.operands]
        return tuple(n for n in dict.fromkeys((*read, *self.outputs)) if n not in self.made)

    @property
    def constants(self) -> tuple[str, ...]:
        """Inputs that stay for a frame."""
        return tuple(name for name in self.inputs if name in CONSTANTS)

    @property
    def fields(self) -> tuple[str, ...]:
        """Inputs that come with each item."""
        return tuple(name for name in self.inputs if name not in CONSTANTS)


@cache
def program(name: str) -> Program:
    """Return one of `TEXTS`, parsed."""
    text, outputs = TEXTS[name]
    return Program(name, parse(text), tuple(outputs.split()))


def culling(depth_interval: bool) -> Program:
    """Return stage 0's program: it culls by the centre's depth, or by the reach of its chunk."""
    return program("cull" + "_interval" * depth_interval)


def projection(config: Config) -> Program:
    """Return stage 1's program, with colours up to `sh_degree` if the array computes them."""
    [name] = (name for name, test in PROJECTIONS.items() if test == config.tile_test)
    shaded = "_sh" if config.sh_degree else "_flat"
    colour = shaded if config.colours == "array" else ""
    dense, compensated = "_dense" * (not config.skip_zeros), "_antialiased" * config.compensates
    return program(name + colour + dense + compensated)


def basis(config: Config) -> Program:
    """Return the program of the colours' polynomials, for `colours` "beside" and degree ≥ 1."""
    return program(f"basis{config.sh_degree}")


def constants(config: Config) -> tuple[str, ...]:
    """Return the names in `CONSTANTS` that a machine uses as registers of the frame."""
    left_out = (*BASIS_CONSTANTS, *(SQUARE_CONSTANTS if config.tile_test == "exact" else ()))
    left_out += () if config.compensates else MODEL_CONSTANTS
    left_out += () if config.levels else LEVEL_CONSTANTS
    return tuple(name for name in CONSTANTS if name not in left_out)


def operation_counts(steps: tuple[Step, ...]) -> dict[str, int]:
    """Return the number of operations of each kind."""
    counts = Counter()
    for step in steps:
        counts.update(step.operations)
    return dict(counts)
