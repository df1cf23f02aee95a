"""Size of a file of waveforms, from its signals and cycles, before anything is simulated."""

from collections.abc import Sequence

from splatcore.sim.machine.wave_names import Signal

DECLARED = 30  # bytes of a signal in a VCD's head, besides its name
CHANGE, WIDE = 4, 3  # bytes of a value in a VCD besides its bits; more of several bits
TIMES = 16  # bytes of a cycle's two times

CHANGING = {
    "TOP.top.preprocess.points.": 0.3,
    "TOP.top.preprocess": 0.03,
    "TOP.top.render": 0.025,
    "TOP.top.axi": 0.025,
    "TOP": 0.2,
}
"""Share of nets that change in a cycle, by the beginning of their module. Measured on TINY: 0.26 to
0.33 within the points' arithmetic, which never rests, 0.02 in its ports, 0.01 to 0.02 in rendering,
0.2 in the top itself; in a stream that never rests 0.4."""

FST = 0.15
"""Bytes of a FST for each of the VCD."""


def estimate(names: Sequence[Signal], cycles: int, kind: str) -> int:
    """Bytes of the waveforms of some signals over so many cycles, within a factor of three."""
    head = sum(DECLARED + len(signal.name) for signal in names)
    size = head + TIMES * cycles
    for signal in {signal.code: signal for signal in names}.values():
        value = CHANGE + signal.width + WIDE * (signal.width > 1)
        share = next(part for name, part in CHANGING.items() if signal.scope.startswith(name))
        size += value * (1 + share * cycles)
    return round(size * (FST if kind == "fst" else 1))
