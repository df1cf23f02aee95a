"""Golden model of the PE arrays: a microprogram, step by step, on all items at once."""

import numpy as np

from splatcore.golden.unary import reciprocal, rsqrt
from splatcore.spec.config import Config
from splatcore.spec.microprogram import Program, Step

Values = dict[str, np.ndarray | float]
"""Float64 values that `Config.arithmetic` holds, by name: [N], or one number for a constant."""

UNARY = {"reciprocal": reciprocal, "rsqrt": rsqrt}


def run(config: Config, program: Program, inputs: Values) -> Values:
    """Every value that the program makes, with its inputs."""
    values = {name: inputs[name] for name in program.inputs}
    with np.errstate(invalid="ignore"):  # NaN is a result like others where the format has it
        for step in program.steps:
            values[step.name] = _evaluate(config, step, values)
    return values


def _evaluate(config: Config, step: Step, values: Values) -> np.ndarray:
    format = config.arithmetic
    a, b, c = (values[name] if name else None for name in (step.a, step.b, step.c))
    if step.unit == "pe":
        product = a if b is None else format.round(a * b)
        if c is None:
            return -product if step.negate else product
        return format.round(c - product if step.negate else c + product)
    if step.unit == "clamp":
        return np.clip(a, -b, b)
    if step.unit == "maximum":
        return np.maximum(a, b)
    return format.decode(UNARY[step.unit](format, format.encode(a)))
