"""Pipeline registers: their distribution over a path, and their enables."""

from collections.abc import Mapping
from itertools import combinations

from amaranth.hdl import Module, Signal, ValueLike

Registers = Mapping[str, int]  # number of registers at each named cut of a path


def spread(latency: int | Registers, cuts: Mapping[str, int]) -> Registers:
    """Place `latency` registers on a path so that the longest stretch of logic is as short as
    possible.

    latency: number of registers; a mapping (registers already placed) is returned unchanged
    cuts: places for registers in the order of the path, each named after the value computed before
        it → approximate depth in gates of the logic since the cut before
    The last cut is the output, which gets the only register at latency 1. If there are more
    registers than cuts, some cuts get several, for a synthesis tool to move into the logic before.
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
    """Depths of the logic between the chosen cuts and the output, longest first."""
    found = [0]
    for cut, depth in cuts.items():
        found[-1] += depth
        if cut in chosen:
            found.append(0)
    return sorted(found, reverse=True)


class Pipeline:
    """Adds pipeline registers to a module; they hold their values while their enable is low.

    They have no reset: outputs are undefined until the first input has passed.

    enable: for all registers; or one bit per cut, so that registers into which nothing valid moves
        hold their values, and their clock can be gated
    """

    def __init__(self, m: Module, enable: Signal, registers: Registers):
        self.m, self.registers = m, registers
        self.enables = dict.fromkeys(registers, enable)
        if len(enable) > 1:
            self.enables = dict(zip(registers, enable, strict=True))

    def cut(self, name: str, *values: ValueLike) -> tuple:
        """Return `values` behind the registers of a cut; the same values if it has none."""
        for _ in range(self.registers.get(name, 0)):
            values = tuple(self._register(name, value) for value in values)
        return values

    def _register(self, name: str, value: ValueLike) -> Signal:
        register = Signal(value.shape(), name=name, reset_less=True)
        with self.m.If(self.enables[name]):
            self.m.d.sync += register.eq(value)
        return register
