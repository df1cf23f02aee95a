"""Frame control: the half that has priority at memory. `tb.formal.frame` proves the rest: ABORT
around a hand-over, and errors that coincide with each other or with the end of a frame."""

import numpy as np
import pytest

from splatcore.hdl.frame import Frame
from splatcore.sim.rtl.streams import Simulation
from splatcore.spec.axi import PREPROCESSING, RENDERING
from splatcore.spec.config import TINY
from tb.helpers.parts import SideBySide

NONE, FIRST, SECOND = 0, 1 << PREPROCESSING, 1 << RENDERING
ROOM = 30  # cycles from one event to the next


def favoured(ends: str) -> list[int]:
    """Return the favoured half after each hand-over, of halves that are always idle on the bus.

    ends: order in which the halves are done, P or R, once both are busy; a half that is done waits
        for the other
    """
    cycles = ROOM * (2 * len(ends) + 6)
    start, done, at = np.zeros(cycles, np.uint64), np.zeros(cycles, np.uint64), ROOM
    looks = []

    def event(array: np.ndarray, value: int, length: int = 1):
        nonlocal at
        array[at : at + length] |= np.uint64(value)
        at += ROOM

    event(start, 1)
    event(done, FIRST, ROOM // 2)  # the first frame, handed over at once
    looks.append(at)
    event(start, 1)
    for pair in zip(ends[::2], ends[1::2], strict=True):
        if pair == ("P", "R"):
            done[at : at + ROOM + ROOM // 2] |= np.uint64(FIRST)  # until it is taken
            at += ROOM
            event(done, SECOND)
        else:
            event(done, SECOND)
            event(done, FIRST, ROOM // 2)
        looks.append(at)
        event(start, 1)
    samples = ("frame__favoured", "frame__working")
    part = Simulation(SideBySide({"frame": Frame(TINY)}), samples)  # `abort` is a name in C++
    inputs = dict.fromkeys(part.ports.driven, 0)
    inputs |= {"frame__idle": -1, "frame__start": start, "frame__done": done}
    found, working = part.run({}, constants=inputs, cycles_max=cycles).samples.values()
    assert (working[np.array(looks[1:]) + 3] == FIRST | SECOND).all()
    return [int(found[look]) for look in looks]


@pytest.mark.slow
def test_the_slower_half_comes_first():
    """No half is favoured after the first frame; then the one that was slower last time."""
    assert favoured("PRPRRPPRRPRP") == [NONE, SECOND, SECOND, FIRST, SECOND, FIRST, FIRST]
