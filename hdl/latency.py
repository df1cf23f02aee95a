"""Registers of a pipeline: where they stand, and the freezing of all of them."""

from collections.abc import Mapping, Sequence

from amaranth.hdl import Module, Signal, ValueLike


def spread(latency: int, cuts: Sequence[str]) -> dict[str, int]:
    """Registers at each named cut of a path, `latency` together, as evenly as cuts allow.

    Cuts are named for what has been computed before them. The last is the output: it is where the
    only register stands at latency 1. More registers than cuts stand several to a cut, for a
    synthesis tool to move.
    """
    if latency < 0:
        raise ValueError(f"latency {latency} is negative")
    # The k-th of L registers stands after the first k/L of the path.
    chosen = [-(-k * len(cuts) // latency) - 1 for k in range(1, latency + 1)]
    return {cut: chosen.count(index) for index, cut in enumerate(cuts)}


class Pipeline:
    """Puts the registers of `spread` into a module; all hold their values while `enable` is low.

    They have no reset: what comes out before the first input has come through means nothing.
    """

    def __init__(self, m: Module, enable: Signal, registers: Mapping[str, int]):
        self.m = m
        self.enable = enable
        self.registers = registers

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
