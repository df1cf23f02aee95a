"""Frame control: memory priority, ABORT around a hand-over, and errors that coincide with each
other or with the end of a frame."""

import numpy as np
import pytest
from amaranth.hdl import Module
from amaranth.lib import wiring

from splatcore.hdl.frame import Frame
from splatcore.spec.axi import PREPROCESSING, READERS, RENDERING, WRITERS
from splatcore.spec.config import TINY
from splatcore.spec.registers import CODE_BITS, ErrorCode
from tb.helpers.parts import forward
from tb.helpers.runs import compiled

pytestmark = pytest.mark.slow


class Renamed(wiring.Component):
    """`Frame` with `aborts` for `abort`, which is a name in C++."""

    def __init__(self):
        self.inner = Frame(TINY)
        self.same = dict(self.inner.signature.members)
        super().__init__(self.same | {"aborts": self.same.pop("abort")})

    def elaborate(self, platform) -> Module:
        m = Module()
        m.submodules.inner = self.inner
        forward(m, self, self.inner, self.same)
        m.d.comb += self.inner.abort.eq(self.aborts)
        return m


NONE, FIRST, SECOND = 0, 1 << PREPROCESSING, 1 << RENDERING
ROOM = 30  # cycles from one event to the next
RESET = 6  # cycles from ABORT until the halves have been reset
SAMPLES = (
    "favoured", "working", "begin", "reset", "gives_up",
    "ready", "frame_event", "started", "finished", "error",
)  # fmt: skip


def run(cycles: int, **constants: np.ndarray) -> dict[str, np.ndarray]:
    """Return the ports' values per cycle of a run between halves that are always idle on the bus.

    constants: inputs that are not always 0
    """
    part = compiled(Renamed, samples=SAMPLES)
    inputs = dict.fromkeys(part.ports.driven, 0) | {"idle": -1} | constants
    samples = part.run({}, constants=inputs, cycles_max=cycles).samples
    return {name: values[:cycles] for name, values in samples.items()}


def favoured(ends: str) -> list[int]:
    """Return the favoured half after each hand-over.

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
    found = run(cycles, start=start, done=done)
    assert (found["working"][np.array(looks[1:]) + 3] == FIRST | SECOND).all()
    return [int(found["favoured"][look]) for look in looks]


def test_the_slower_half_comes_first():
    """No half is favoured after the first frame; then the one that was slower last time."""
    assert favoured("PRPRRPPRRPRP") == [NONE, SECOND, SECOND, FIRST, SECOND, FIRST, FIRST]


@pytest.mark.parametrize("after", range(-3, 6))
def test_abort_around_a_hand_over(after):
    """ABORT ends every frame in flight, also in the cycle in which the first half is done; START
    while READY begins a frame, however soon it comes."""
    through, again = ROOM, range(12)
    for wait in again:
        names = ("start", "abort", "done")
        start, abort, done = (np.zeros(3 * ROOM, np.uint64) for _ in names)
        aborted = through + after
        start[[5, aborted + 1 + wait]] = 1
        abort[aborted] = 1
        done[through : through + 1 if after > 0 else aborted + RESET] = FIRST  # until it is taken
        start &= run(3 * ROOM, start=start, aborts=abort, done=done)["ready"]  # only while READY
        found = run(3 * ROOM, start=start, aborts=abort, done=done)
        begun = (found["begin"] & FIRST).astype(bool)
        assert begun.sum() == start.sum() == found["started"][-1], f"START after {wait} cycles"
        rendered, given_up = ((found[name] & SECOND).any() for name in ("begin", "reset"))
        assert rendered == given_up == (after > 0)
        assert found["working"][-1] == (FIRST if start.sum() > 1 else 0)


READ = {half: 1 | [*READERS.values()].index(half) << 1 for half in (PREPROCESSING, RENDERING)}
WRITE = {half: 1 | [*WRITERS.values()].index(half) << 1 for half in (PREPROCESSING, RENDERING)}
FAILS = 1 | ErrorCode.PAGES << 1


@pytest.mark.parametrize(
    "faults, code, halves",
    [
        ({"read_error": READ[PREPROCESSING]}, ErrorCode.READ, FIRST),
        ({"write_error": WRITE[RENDERING]}, ErrorCode.WRITE, SECOND),
        ({"fails": FAILS}, ErrorCode.PAGES, FIRST),
        (
            {"read_error": READ[PREPROCESSING], "write_error": WRITE[RENDERING]},
            ErrorCode.WRITE,
            FIRST | SECOND,
        ),
        ({"read_error": READ[RENDERING], "fails": FAILS}, ErrorCode.PAGES, FIRST | SECOND),
        ({"read_error": READ[RENDERING], "aborts": 1}, ErrorCode.READ, SECOND),
    ],
)
def test_errors_of_both_halves_in_one_cycle(faults, code, halves):
    """One error is reported; `gives_up` marks every half whose frame ended by an error."""
    cycles, at = 3 * ROOM, 2 * ROOM
    inputs = {name: np.zeros(cycles, np.uint64) for name in ("start", "done", *faults)}
    inputs["start"][[5, ROOM + 5]] = 1
    inputs["done"][ROOM] = FIRST
    for name, value in faults.items():
        inputs[name][at : at + 2] = value  # in the second cycle the half fails already
    found = run(cycles, **inputs)
    assert found["working"][at] == FIRST | SECOND
    assert found["error"][at] & 1 and found["error"][at] >> 1 & (1 << CODE_BITS) - 1 == code
    assert found["gives_up"][at] == halves and found["gives_up"].sum() == halves
    given_up = FIRST | SECOND if "aborts" in faults else halves
    assert found["reset"].max() == given_up and found["working"][-1] == (FIRST | SECOND) - given_up


@pytest.mark.parametrize(
    "faults, given_up",
    [
        ({"read_error": READ[RENDERING]}, SECOND),
        ({"write_error": WRITE[RENDERING]}, SECOND),
        ({"read_error": READ[PREPROCESSING]}, NONE),  # of the other half, which is idle
        ({"aborts": 1}, NONE),
    ],
)
def test_rendering_ends_in_the_cycle_of_an_error(faults, given_up):
    """With an error of this half the frame ends without FRAME; with ABORT it is complete. In both
    cases the next frame is rendered."""
    cycles, at = 5 * ROOM, 2 * ROOM
    inputs = {name: np.zeros(cycles, np.uint64) for name in ("start", "done", *faults)}
    inputs["start"][[5, 3 * ROOM]] = 1
    inputs["done"][[ROOM, 4 * ROOM]] = FIRST
    inputs["done"][at] = SECOND
    for name, value in faults.items():
        inputs[name][at] = value
    found = run(cycles, **inputs)
    assert found["working"][at] == SECOND and found["working"][3 * ROOM] == NONE
    assert found["gives_up"].sum() == found["gives_up"][at] == given_up
    assert found["finished"][-1] == (0 if given_up else 1)
    assert found["frame_event"].sum() == found["frame_event"][at] == found["finished"][-1]
    assert found["working"][-1] == SECOND and (found["begin"] == SECOND).sum() == 2
