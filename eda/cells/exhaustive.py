"""Outputs of a circuit that are 0 for all inputs, found by trying all inputs.

Products are hard to prove by other ways, but have few inputs.
"""

import re
from collections.abc import Iterable

import numpy as np

INPUTS_MAX = 28
"""Maximum number of inputs: 2^28 patterns of 2,000 gates take some 20 s."""

BLOCK = 12  # log2 of the words of 64 patterns that are simulated together
LOW = 6 + BLOCK
ONES = ~np.uint64(0)

Tables = dict[str, tuple[list[str], list[tuple[str, str]]]]


def always_zero(text: str, outputs: Iterable[str]) -> set[str]:
    """Outputs that are 0 for all inputs; those with more than `INPUTS_MAX` inputs are left out.

    text: the circuit in BLIF
    outputs: names of the outputs to be tried
    """
    tables = _tables(text)
    cones = {output: _cone(tables, output) for output in outputs}
    cones = {output: cone for output, cone in cones.items() if len(cone[0]) <= INPUTS_MAX}
    groups: list[tuple[set[str], list[str]]] = []
    for output in sorted(cones, key=lambda output: len(cones[output][0]), reverse=True):
        inputs, _ = cones[output]
        for of, together in groups:
            if inputs <= of:
                together.append(output)
                break
        else:
            groups.append((inputs, [output]))
    found: set[str] = set()
    for inputs, together in groups:
        gates = dict.fromkeys(gate for output in together for gate in cones[output][1])
        found |= _zero(tables, sorted(inputs), list(gates), together)
    return found


def _tables(text: str) -> Tables:
    """Operands and rows of each table, by its output."""
    found: Tables = {}
    pattern = r"^\.names (.*)\n((?:[^.\n].*\n)*)"
    for nets, rows in re.findall(pattern, text.replace("\\\n", " "), re.M):
        *operands, output = nets.split()
        found[output] = operands, [tuple(row.split()) for row in rows.splitlines() if operands]
        if not operands:
            found[output] = [], [("", row.strip()) for row in rows.splitlines()]
    return found


def _cone(tables: Tables, output: str) -> tuple[set[str], list[str]]:
    """Inputs of an output, and the tables on its paths, operands first."""
    inputs, order, seen, stack = set(), [], set(), [(output, False)]
    while stack:
        net, is_done = stack.pop()
        if is_done:
            order.append(net)
        elif net not in tables:
            inputs.add(net)
        elif net not in seen:
            seen.add(net)
            stack.append((net, True))
            stack += [(operand, False) for operand in tables[net][0]]
    return inputs, order


def _zero(tables: Tables, inputs: list[str], gates: list[str], outputs: list[str]) -> set[str]:
    """Outputs that are 0 for all values of these inputs."""
    within, number = np.arange(64), np.arange(1 << BLOCK, dtype=np.uint64)
    left, values = set(outputs), {}
    for k, net in enumerate(inputs[:LOW]):
        low = sum(1 << int(place) for place in within if place >> k & 1) if k < 6 else 0
        high = (number >> np.uint64(k - 6) & np.uint64(1)) * ONES if k >= 6 else None
        values[net] = np.full(1 << BLOCK, low, np.uint64) if high is None else high
    for block in range(1 << max(len(inputs) - LOW, 0)):
        for k, net in enumerate(inputs[LOW:]):
            values[net] = ONES if block >> k & 1 else np.uint64(0)
        for gate in gates:
            values[gate] = _value(values, *tables[gate])
        left -= {output for output in left if np.any(values[output])}
    return left


def _value(values: dict, operands: list[str], rows: list[tuple[str, str]]):
    """The output of a table: rows list the patterns for which it is 1, or for which it is 0."""
    found = np.uint64(0)
    for pattern, _ in rows:
        row = ONES
        for operand, bit in zip(operands, pattern, strict=True):
            if bit != "-":
                row = row & (values[operand] if bit == "1" else ~values[operand])
        found = found | row
    return ~found if rows and rows[0][1] == "0" else found
