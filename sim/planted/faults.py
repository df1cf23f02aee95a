"""What can be wrong with a line of Verilog, as Amaranth writes it: one thing a time.

What no output depends on is left out, bit by bit; so are faults that change nothing as they stand.
Others may still be equivalent to the original: nobody looks at which states are reached.
"""

import random
import re
from collections.abc import Iterator
from typing import NamedTuple

from splatcore.sim.planted.netlist import SELECT, Expression, Module, Place, Used, modules

HANDSHAKE = re.compile("valid|ready|enable")
"""What the names of signals that let items pass have in common."""

BINARY = {
    "+": "-", "-": "+", "*": "+", "&": "|", "|": "&", "^": "~^", "&&": "||", "||": "&&",
    "==": "!=", "!=": "==", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "<<": ">>", ">>": "<<",
    "<<<": ">>>", ">>>": "<<<",
}  # fmt: skip
LEFT_ALONE = {"~": "", "!": "", "-": "", "&": "|", "|": "&", "^": "~^"}

KINDS = ("operator", "constant", "index", "condition", "reset", "stall")
"""What may be wrong: an operator is another one or missing, or a choice takes the other side; a
bit of a literal is flipped; a bit or slice is taken one off; a condition is always true or never;
a register has another value after reset; a handshake signal is always high."""


class Fault(NamedTuple):
    kind: str
    value: str  # to stand in the place of the right one


def faults(lines: list[str], rng: random.Random) -> Iterator[tuple[Module, Place, list[Fault]]]:
    """What can be wrong on each line that an output depends on; `rng` chooses among bits."""
    found = modules(lines)
    used = Used(found)
    for module in found:
        for block in module.blocks:
            if used.alive(module, block):
                for place in block.places:
                    if all(module.truth(condition) is not False for condition in place.inside):
                        yield module, place, _faults(module, place, used, rng)


def _faults(module: Module, place: Place, used: Used, rng: random.Random) -> list[Fault]:
    target, value = Expression(module, place.target), Expression(module, place.value)
    live = used.live(target)
    if live == 0 or place.value.strip() == "rst":
        return []
    constants = list(_constants(value, live, rng))
    if any(condition.strip() == "rst" for condition in place.inside):
        return [Fault("reset", text) for text in constants]
    found = [Fault("stall", text) for text in _stalls(target, value)]
    if not place.target:
        is_now = module.truth(place.value)
        found += [Fault("condition", f"1'h{k}") for k in (1, 0) if is_now is not bool(k)]
    found += [Fault("operator", text) for text in _operators(value, live)]
    found += [Fault("constant", text) for text in constants]
    found += [Fault("index", text) for text in _indices(target, value, live, rng)]
    different = {place.value.strip(): None}
    for fault in found:
        different.setdefault(fault.value.strip(), fault)
    return [fault for fault in different.values() if fault]


def _stalls(target: Expression, value: Expression) -> Iterator[str]:
    """Handshake signals always high, where they are made and where they are used."""
    for item in target.items:
        if HANDSHAKE.search(item.name) and item.first == item.last and item.width:
            yield f"{item.width}'h{(1 << item.width) - 1:x}"
    for item in value.items:
        if HANDSHAKE.search(item.name) and item.first == item.last and item.width == 1:
            yield value.changed(item.first, "1'h1")


def _operators(value: Expression, live: int) -> Iterator[str]:
    """Other operators, operators left out, and choices swapped."""
    for k, token in enumerate(value.tokens):
        if token == "?":
            colon = value.tokens.index(":", k)
            first, second = value.text(k + 1, colon), value.text(colon + 1)
            yield f"{value.text(0, k + 1)}{second} : {first}"
        elif token in LEFT_ALONE and value.unary(k):
            one_bit = "{" not in value.text(k + 1, k + 3) and value.width(k + 1, k + 3) == 1
            if not (token in "&|^" and one_bit):  # which reduces nothing
                yield value.changed(k, LEFT_ALONE[token])
        elif token in BINARY and not (token in "+-" and live == 1):  # in bit 0 these are the same
            yield value.changed(k, BINARY[token])


def _constants(value: Expression, live: int, rng: random.Random) -> Iterator[str]:
    """A bit of each literal flipped, one that reaches a bit that is used."""
    for k, token in enumerate(value.tokens):
        match = re.fullmatch(r"(\d+)'(s?)([bdh])([0-9a-f]+)", token)
        if not match:
            continue
        width, sign, base, digits = match.groups()
        needed = value.needed(k, k, live)
        bits = [bit for bit in range(int(width)) if needed >> bit & 1]
        if bits:
            flipped = int(digits, {"b": 2, "d": 10, "h": 16}[base]) ^ 1 << rng.choice(bits)
            yield value.changed(k, f"{width}'{sign}h{flipped:x}")


def _indices(target: Expression, value: Expression, live: int, rng: random.Random) -> Iterator[str]:
    """Bits and slices one off."""
    made = {item.name for item in target.items}  # a signal made of itself might be a loop
    for item in value.items:
        match = SELECT.fullmatch(value.tokens[item.last])
        if not match or item.name in made or not value.needed(item.first, item.last, live):
            continue
        low, high = item.low, item.low + item.width - 1
        limit = value.module.widths.get(item.name, 0)
        steps = [step for step in (-1, 1) if low + step >= 0 and high + step < limit]
        if steps:
            step = rng.choice(steps)
            moved = f"[{high + step}:{low + step}]" if match[2] else f"[{high + step}]"
            yield value.changed(item.last, moved)
