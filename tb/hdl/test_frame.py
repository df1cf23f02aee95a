"""Frame control: which half memory serves first."""

import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out, connect, flipped

from splatcore.hdl.frame import Frame
from splatcore.spec.axi import PREPROCESSING, RENDERING
from splatcore.spec.config import TINY
from tb.helpers.runs import compiled

pytestmark = pytest.mark.slow


class Halves(wiring.Component):
    """`Frame` between halves that are always idle on the bus; `looks` is a stream of nothing.

    start; done: a bit for each half. favoured, working: those of `Frame`.
    """

    def __init__(self):
        bits = stream.Signature(1)
        ports = {"looks": In(bits), "seen": Out(bits), "start": In(1), "done": In(2)}
        super().__init__(ports | {"favoured": Out(2), "working": Out(2)})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.frame = frame = Frame(TINY)
        connect(m, flipped(self).looks, flipped(self).seen)
        m.d.comb += [
            frame.start.eq(self.start),
            frame.done.eq(self.done),
            frame.idle.eq(-1),
            self.favoured.eq(frame.favoured),
            self.working.eq(frame.working),
        ]
        return m


NONE, FIRST, SECOND = 0, 1 << PREPROCESSING, 1 << RENDERING
ROOM = 30  # cycles from one event to the next


def favoured(ends: str) -> list[int]:
    """What is favoured after each frame has been handed over. ends: halves in the order in which
    they are through, P or R, once both are at work; a half that is through waits for the other."""
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
    part = compiled(Halves, samples=("favoured", "working"))
    nothing = np.zeros((0, 1), np.uint8)
    found = part.run(
        {"looks": nothing}, constants={"start": start, "done": done}, cycles_max=cycles,
        idle_max=cycles,
    )  # fmt: skip
    assert (found.samples["working"][np.array(looks[1:]) + 3] == FIRST | SECOND).all()
    return [int(found.samples["favoured"][look]) for look in looks]


def test_the_slower_half_comes_first():
    """Nothing is known after the first frame; then it is as the last frame was."""
    assert favoured("PRPRRPPRRPRP") == [NONE, SECOND, SECOND, FIRST, SECOND, FIRST, FIRST]
