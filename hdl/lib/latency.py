"""Pipeline registers: their distribution over a path, and one enable for all of them."""

from collections.abc import Mapping
from itertools import combinations

from amaranth.hdl import Module, Signal, ValueLike

Registers = Mapping[str, int]  # number of registers at each named cut of a path


def spread(latency: int | Registers, cuts: Mapping[str, int]) -> Registers:
    """`latency` registers on a path, so that the longest stretch without one is the shortest.

    Registers whose cuts are chosen already are returned as they are.

    `cuts` are the places where registers can stand, in the path's order, each named for what has
    been computed before it; with about how many gates deep the logic is between it and the cut
    before. The last is the output: it is where the only register stands at latency 1. More
    registers than cuts stand several to a cut, for a synthesis tool to move into the logic before.
    """
    if isinstance(latency, Mapping):
        return latency
    if latency < 0:
        raise ValueError(f"latency {latency} is negative")
    *inner, output = cuts
    registers = dict.fromkeys(cuts, 0)
    if latency:
        count = min(latency - 1, len(inner))
        chosen = min(combinations(inner, count), key=lambda chosen: stretches(cuts, chosen))
        registers |= dict.fromkeys((*chosen, output), 1)
    for _ in range(latency - len(cuts)):
        registers[max(cuts, key=lambda cut: cuts[cut] / registers[cut])] += 1
    return registers


def stretches(cuts: Mapping[str, int], chosen: tuple[str, ...]) -> list[int]:
    """Depths of the logic between registers at the chosen cuts and at the output, longest first."""
    found = [0]
    for cut, depth in cuts.items():
        found[-1] += depth
        if cut in chosen:
            found.append(0)
    return sorted(found, reverse=True)


class Pipeline:
    """Adds pipeline registers to a module; all hold their values while `enable` is low.

    They have no reset: what comes out before the first input has come through means nothing.
    """

    def __init__(self, m: Module, enable: Signal, registers: Registers):
        self.m, self.enable, self.registers = m, enable, registers

    def cut(self, name: str, *values: ValueLike) -> tuple:
        """`values` behind the registers of one cut; themselves if there are none."""
        for _ in range(self.registers.get(name, 0)):
            values = tuple(self._register(name, value) for value in values)
        return values

    def _register(self, name: str, value: ValueLike) -> Signal:
        register = Signal(value.shape(), name=name, reset_less=True)
        with self.m.If(self.enable):
            self.m.d.sync += register.eq(value)
        return register
