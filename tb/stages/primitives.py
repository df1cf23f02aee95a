"""Stream primitives side by side; `tb.formal.stream` proves their capacity."""

import numpy as np

from splatcore.hdl.lib.stream import Fork, Queue, Register, Slot, Stage
from tb.helpers.parts import Piped, SideBySide
from tb.helpers.runs import Case

WIDTH, ITEMS = 16, 200

LATENCIES = {
    "register": 1, "slot": 1, "stage": 1, **{f"queue_{n}": 1 for n in (2, 5, 8)},
    **{f"memory_{n}": 2 for n in (3, 8)}, "fork": 0, **{f"pipe_{n}": n for n in (1, 4)},
}  # fmt: skip
"""Cycles from a part's input to its output."""

MADE = {
    "register": Register, "slot": Slot, "stage": Stage, "queue": Queue, "pipe": Piped,
    "memory": lambda width, depth: Queue(width, depth, memory=True),
    "fork": lambda width: Fork(width, 3),
}  # fmt: skip


def outputs(name: str) -> list[str]:
    """Names of a part's output streams."""
    return [f"fork__o__{k}" for k in range(3)] if name == "fork" else [f"{name}__o"]


class Primitives(SideBySide):
    """All parts."""

    def __init__(self):
        made = {}
        for name in LATENCIES:
            kind, _, size = name.partition("_")
            made[name] = MADE[kind](WIDTH, *map(int, filter(None, [size])))
        super().__init__(made)


def items(count: int = ITEMS) -> Case:
    """The same random items for all parts; each output has all of them, in order."""
    rows = np.random.default_rng(0).integers(0, 256, (count, WIDTH // 8), np.uint8)
    given = {f"{name}__i": rows for name in LATENCIES}
    return Case(given, {o: rows for name in LATENCIES for o in outputs(name)})
