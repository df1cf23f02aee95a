"""Microprograms: what a line means, and a program's steps and names.

A line `name = …` makes one value, once. Products and sums run on the processing elements (PEs), a
multiplier followed by an adder, each of which rounds; either can be bypassed:

    a * b        a * b + c        c - a * b        a + c        c - a

The other steps have units of their own, of which there is one each:

    reciprocal(a)     1/a
    rsqrt(a)           1/√a
    clamp(a, limit)   a within ± limit
    maximum(a, b)     the larger one
    product(a, b)     and the others of `spec.compensation`, which are no floats of the arithmetic

What no line makes is an input: one of `CONSTANTS`, which stay for a frame, or a field that comes
with each item. Values are floats of `Config.arithmetic`, those of the cull programs of
`spec.depth.finer`. Lines may stand in any order
that makes a value before it is used; when each runs is decided in `spec.schedule`. The programs are
in `spec.programs`.
"""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cache

from splatcore.spec.compensation import MODEL_CONSTANTS
from splatcore.spec.config import Config
from splatcore.spec.programs import (
    BASIS_CONSTANTS,
    CONSTANTS,
    PROJECTIONS,
    SQUARE_CONSTANTS,
    TEXTS,
)

COMPENSATION_UNITS = ("product", "minor", "log", "log_sum", "fade")
"""Units of machines that compensate (`spec.compensation`)."""

UNITS = ("pe", "reciprocal", "rsqrt", "clamp", "maximum", *COMPENSATION_UNITS)
"""Units that steps run on."""

PATTERNS = (
    (r"(?P<a>\w+) \* (?P<b>\w+)", "pe", False),
    (r"(?P<a>\w+) \* (?P<b>\w+) \+ (?P<c>\w+)", "pe", False),
    (r"(?P<c>\w+) - (?P<a>\w+) \* (?P<b>\w+)", "pe", True),
    (r"(?P<a>\w+) \+ (?P<c>\w+)", "pe", False),
    (r"(?P<c>\w+) - (?P<a>\w+)", "pe", True),
    (r"(?P<unit>\w+)\((?P<a>\w+)(, (?P<b>\w+))?\)", None, False),
    (r"(?P<unit>minor)\((?P<a>\w+), (?P<b>\w+), (?P<c>\w+)\)", None, False),
)


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
        """The line that says it."""
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
        """Multiplications, additions, reciprocals … in the step, as the paper counts them."""
        if self.unit != "pe":
            return {self.unit: 1}
        return {"multiply": int(self.b is not None), "add": int(self.c is not None)}


def parse(text: str) -> tuple[Step, ...]:
    """Steps of a program; ValueError, naming the line, for anything else than the lines above."""
    steps: list[Step] = []
    for number, line in enumerate(text.splitlines(), 1):
        line = line.partition("#")[0].strip()
        if line:
            steps.append(_parse_line(line, number, {step.name for step in steps}))
    return tuple(steps)


def _parse_line(line: str, number: int, made: set[str]) -> Step:
    name, _, right = line.partition(" = ")
    for pattern, unit, negate in PATTERNS:
        match = re.fullmatch(pattern, right)
        if match:
            found = {key: value for key, value in match.groupdict().items() if value}
            step = Step(name, **({"unit": unit} | found), negate=negate)
            if step.unit not in UNITS or name in made:
                break
            return step
    raise ValueError(f"microprogram line {number}: '{line}'")


@dataclass(frozen=True)
class Program:
    """Steps and what goes in and out: names of values."""

    name: str
    steps: tuple[Step, ...]
    outputs: tuple[str, ...]

    @property
    def made(self) -> set[str]:
        return {step.name for step in self.steps}

    @property
    def inputs(self) -> tuple[str, ...]:
        """Operands that no step makes, in the order of their first use."""
        read = [operand for step in self.steps for operand in step.operands]
        return tuple(n for n in dict.fromkeys((*read, *self.outputs)) if n not in self.made)

    @property
    def constants(self) -> tuple[str, ...]:
        return tuple(name for name in self.inputs if name in CONSTANTS)

    @property
    def fields(self) -> tuple[str, ...]:
        """Inputs that come with each item."""
        return tuple(name for name in self.inputs if name not in CONSTANTS)


@cache
def program(name: str) -> Program:
    """One of `TEXTS`, parsed."""
    text, outputs = TEXTS[name]
    return Program(name, parse(text), tuple(outputs.split()))


def culling(depth_interval: bool) -> Program:
    """Stage 0's program: by the centre's depth, or by how far a Gaussian there can reach."""
    return program("cull" + "_interval" * depth_interval)


def projection(config: Config) -> Program:
    """Stage 1's program, with colours of models of `config.sh_degree` if the array makes them."""
    [name] = (name for name, test in PROJECTIONS.items() if test == config.tile_test)
    shaded = "_sh" if config.sh_degree else "_flat"
    colour = shaded if config.colours == "array" else ""
    dense, compensated = "_dense" * (not config.skip_zeros), "_antialiased" * config.compensates
    return program(name + colour + dense + compensated)


def basis(config: Config) -> Program:
    """The program of the polynomials that a machine of degree 1 or more makes beside the array."""
    return program(f"basis{config.sh_degree}")


def constants(config: Config) -> tuple[str, ...]:
    """Those of `CONSTANTS` that a machine is given."""
    left_out = (*BASIS_CONSTANTS, *(SQUARE_CONSTANTS if config.tile_test == "exact" else ()))
    left_out += () if config.compensates else MODEL_CONSTANTS
    return tuple(name for name in CONSTANTS if name not in left_out)


def operation_counts(steps: tuple[Step, ...]) -> dict[str, int]:
    """Operations of a program by kind."""
    counts = Counter()
    for step in steps:
        counts.update(step.operations)
    return dict(counts)
