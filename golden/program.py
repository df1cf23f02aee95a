"""Golden model of the PE arrays: runs a microprogram on all items at once."""

from itertools import groupby

import numpy as np

from splatcore.golden import compensation
from splatcore.golden.pe import ABSENT, evaluate
from splatcore.golden.unary import values_of
from splatcore.spec.config import Config
from splatcore.spec.microprogram import COMPENSATION_UNITS, Program, Step

Values = dict[str, np.ndarray | float]
"""Float64 values that `Config.arithmetic` holds, by name: [N], or one number for a constant."""


def run(config: Config, program: Program, inputs: Values) -> Values:
    """Return every value that the program computes, and its inputs."""
    found = {name: inputs[name] for name in program.inputs}
    number = {name: k for k, name in enumerate((*found, *(step.name for step in program.steps)))}
    [count] = np.broadcast_shapes((1,), *map(np.shape, found.values()))
    values = np.empty((len(number), count))
    for name, value in found.items():
        values[number[name]] = value
    for on_pe, steps in groupby(program.steps, lambda step: step.unit == "pe"):
        if on_pe:
            evaluate(_numbered(steps, number), values, config.arithmetic)
            continue
        for step in steps:
            operands = [values[number[name]] for name in step.operands]
            values[number[step.name]] = _other(config, step.unit, *operands)
    return found | {step.name: values[number[step.name]] for step in program.steps}


def _numbered(steps: list[Step], number: dict[str, int]) -> np.ndarray:
    """Return steps in the form that `evaluate` takes."""
    absent = number | {None: ABSENT}
    return np.array([[absent[n] for n in (s.name, s.a, s.b, s.c)] + [s.negate] for s in steps])


def _other(config: Config, unit: str, a: np.ndarray, *others: np.ndarray) -> np.ndarray:
    """Return the value of a step on a unit other than a PE."""
    if unit == "clamp":
        (limit,) = others
        return np.clip(a, -limit, limit)
    if unit == "maximum":
        return np.maximum(a, *others)
    if unit in COMPENSATION_UNITS:
        return getattr(compensation, unit)(config, a, *others)
    return values_of(unit, config.arithmetic, a)
