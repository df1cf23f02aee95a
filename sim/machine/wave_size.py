"""Estimated size of a waveform file, from its signals and cycles, before simulation."""

from collections.abc import Sequence

from splatcore.sim.machine.wave_names import Signal

DECLARED = 30  # bytes per signal in a VCD's header, without its name
CHANGE, WIDE = 4, 3  # bytes per value in a VCD, without its bits; extra if it has several bits
TIMES = 16  # bytes per cycle for its two time stamps

CHANGING = {
    "TOP.top.preprocess.points.": 0.3,
    "TOP.top.preprocess": 0.03,
    "TOP.top.render": 0.025,
    "TOP.top.axi": 0.025,
    "TOP": 0.2,
}
"""Share of nets that change per cycle, by prefix of their module's path. Measured on TINY: 0.26 to
0.33 in the points' arithmetic, which is never idle, 0.02 in its ports, 0.01 to 0.02 in rendering,
0.2 in the top itself; 0.4 in a stream that is never idle."""

FST = 0.15
"""Size of a FST relative to the VCD."""


def estimate(names: Sequence[Signal], cycles: int, kind: str) -> int:
    """Bytes of the waveforms of some signals over `cycles`, within a factor of three."""
    head = sum(DECLARED + len(signal.name) for signal in names)
    size = head + TIMES * cycles
    for signal in {signal.code: signal for signal in names}.values():
        value = CHANGE + signal.width + WIDE * (signal.width > 1)
        share = next(part for name, part in CHANGING.items() if signal.scope.startswith(name))
        size += value * (1 + share * cycles)
    return round(size * (FST if kind == "fst" else 1))
