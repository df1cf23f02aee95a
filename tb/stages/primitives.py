"""Stream primitives side by side, with what their docstrings promise."""

from dataclasses import dataclass

import numpy as np
from amaranth.hdl import Cat, Module
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.stream import Fork, Queue, Register, Slot, Stage, passes
from tb.helpers.parts import Piped, SideBySide
from tb.helpers.runs import Case

WIDTH, ITEMS = 16, 200


@dataclass(frozen=True)
class Promise:
    """latency: cycles; capacity: items that fit; pace: cycles per item; outputs: streams"""

    latency: int
    capacity: int
    pace: int = 1
    outputs: int = 1


PROMISES = {
    "register": Promise(1, 2),
    "slot": Promise(1, 1, pace=2),
    "stage": Promise(1, 1),
    **{f"queue_{n}": Promise(1, n) for n in (2, 5, 8)},
    **{f"memory_{n}": Promise(2, n) for n in (3, 8)},
    "fork": Promise(0, 0, outputs=3),
    **{f"pipe_{n}": Promise(n, n) for n in (1, 4)},
}

MADE = {
    "register": Register, "slot": Slot, "stage": Stage, "queue": Queue, "pipe": Piped,
    "memory": lambda width, depth: Queue(width, depth, memory=True),
    "fork": lambda width: Fork(width, 3),
}  # fmt: skip


def outputs(name: str) -> list[str]:
    """Names of a part's output streams."""
    count = PROMISES[name].outputs
    return [f"{name}__o"] if count == 1 else [f"{name}__o__{k}" for k in range(count)]


class Primitives(SideBySide):
    """All parts.

    Members, in addition to those of the parts under their names
        comes: one bit per part: an item enters
        goes: one bit per part: an item leaves at the first output
        hold: all outputs are stalled
    """

    def __init__(self):
        made = {}
        for name in PROMISES:
            kind, _, size = name.partition("_")
            made[name] = MADE[kind](WIDTH, *map(int, filter(None, [size])))
        super().__init__(made, comes=Out(len(made)), goes=Out(len(made)), hold=In(1))

    def elaborate(self, platform) -> Module:
        m = super().elaborate(platform)
        parts = [getattr(self, name) for name in self.components]
        with m.If(self.hold):
            for outer, inner in zip(parts, self.components.values(), strict=True):
                for o, own in zip(streams(outer.o), streams(inner.o), strict=True):
                    m.d.comb += [o.valid.eq(0), own.ready.eq(0)]
        m.d.comb += self.comes.eq(Cat(passes(part.i) for part in parts))
        m.d.comb += self.goes.eq(Cat(passes(streams(part.o)[0]) for part in parts))
        return m


def streams(o) -> list:
    """The streams of an output or of an array of outputs."""
    return [o] if hasattr(o, "valid") else list(o)


def items(count: int = ITEMS) -> Case:
    """The same random items for all parts; each output has all of them, in order."""
    rows = np.random.default_rng(0).integers(0, 256, (count, WIDTH // 8), np.uint8)
    given = {f"{name}__i": rows for name in PROMISES}
    return Case(given, {o: rows for name in PROMISES for o in outputs(name)}, {"hold": 0})
