"""Proofs of the stream primitives, and tests that a proof can fail."""

from collections.abc import Callable
from functools import partial

import pytest
from amaranth.hdl import Assert, Assume, Cover, Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In

from splatcore.hdl.lib.stream import Fork, Pipe, Queue, Register, Slot, Stage
from splatcore.sim.rtl.formal import ProofError, cover, prove, search
from tb.formal.stream import (
    WIDTH,
    Followed,
    Forked,
    WatchedQueue,
    in_pipe,
    in_queue,
    in_register,
    in_slot,
    in_stage,
)
from tb.helpers.parts import Piped, SideBySide
from tb.planted.fault import each, plant

pytestmark = pytest.mark.slow

COVER_DEPTH = 8  # cycles in which an item can enter and leave each part below


def queue(depth: int, memory: bool = False) -> Followed:
    return Followed(WatchedQueue(depth, memory), in_queue, latency=1 + memory, capacity=depth)


def pipe(latency: int) -> Followed:
    return Followed(Piped(WIDTH, latency), in_pipe, latency, capacity=latency)


PROOFS = {
    "register": lambda: Followed(Register(WIDTH), in_register, latency=1, capacity=2),
    "slot": lambda: Followed(Slot(WIDTH), in_slot, latency=1, capacity=1),
    "stage": lambda: Followed(Stage(WIDTH), in_stage, latency=1, capacity=1),
    **{f"queue_{depth}": partial(queue, depth) for depth in (2, 5)},  # 5: not a power of two
    **{f"memory_{depth}": partial(queue, depth, True) for depth in (3, 8)},
    **{f"pipe_{latency}": partial(pipe, latency) for latency in (1, 4)},
    "fork": lambda: Forked(Fork(WIDTH, 3)),
}


def beside(*names: str) -> SideBySide:
    """Return parts side by side, so that one solver run covers them all."""
    return SideBySide({name: PROOFS[name]() for name in names})


def test_stream():
    prove(beside(*PROOFS))


def test_stream_is_reached():
    """The cases of the assertions are reachable, so no assertion holds for lack of cases."""
    cover(beside("register", "slot", "stage", "memory_3", "pipe_4", "fork"), COVER_DEPTH)


FAULTS = {
    "an item too many": ("register", Register, "self.i.ready.eq(~self.full)", "self.i.ready.eq(1)"),
    "taken while full": ("slot", Slot, "self.i.ready.eq(ready)", "self.i.ready.eq(1)"),
    "lost to the next": ("stage", Stage, "~self.o.valid | self.o.ready", "1"),
    "full too late": ("queue_5", Queue, "self.level != self.depth", "self.level <= self.depth"),
    "fetched from nowhere": ("memory_3", Queue, "self.level != self.o.valid", "1"),
    "halts too late": ("pipe_4", Pipe, "~self.o.valid | self.o.ready", "1"),
    "given twice": ("fork", Fork, "self.i.valid & ~self.taken[k]", "self.i.valid"),
}


@pytest.mark.parametrize("fault", each(FAULTS))
def test_fault_is_found(fault, monkeypatch):
    name, part, old, new = FAULTS[fault]
    plant(monkeypatch, part, "elaborate", old, new)
    with pytest.raises(ProofError, match="fails in step") as found:
        prove(PROOFS[name]())
    assert found.value.step is not None
    assert found.value.lines
    assert all("formal/stream.py" in line for line in found.value.lines)


class Counter(wiring.Component):
    """Counts from 0 to 5 and stays there; `check` makes a statement about its value."""

    def __init__(self, check: Callable):
        super().__init__({"i": In(1)})
        self.check = check

    def elaborate(self, platform) -> Module:
        m = Module()
        value = Signal(3)
        m.d.sync += value.eq(Mux(value == 5, 5, value + 1))
        m.d.comb += self.check(value)
        return m


def test_step():
    with pytest.raises(ProofError, match="fails in step 0") as found:
        prove(Counter(lambda value: Assert(value != 0)))
    assert found.value.step == 0
    search(Counter(lambda value: Assert(value != 5)), depth=5)
    for check in (prove, search):
        with pytest.raises(ProofError, match=r"fails in step 5: .*test_formal.py:\d+$") as found:
            check(Counter(lambda value: Assert(value != 5)), depth=6)
        assert found.value.step == 5


def test_true_but_not_by_induction():
    """Before 7 comes 6, and before 6 only 5, which stays: induction needs one cycle more."""
    with pytest.raises(ProofError, match="does not follow by induction over 1 cycles") as found:
        prove(Counter(lambda value: Assert(value != 7)), depth=1)
    assert found.value.step is None and len(found.value.lines) == 1
    prove(Counter(lambda value: Assert(value != 7)), depth=2)


def test_cover():
    cover(Counter(lambda value: Cover(value == 5)), depth=6)
    with pytest.raises(ProofError, match=r"not reached in 5 cycles: .*test_formal.py:\d+$"):
        cover(Counter(lambda value: Cover(value == 5)), depth=5)
    with pytest.raises(ProofError, match="not reached"):
        cover(Counter(lambda value: [Assume(value != 3), Cover(value == 5)]), depth=8)


@pytest.mark.parametrize("check", [prove, search, cover])
def test_nothing_to_check(check):
    with pytest.raises(ValueError, match="nothing to check"):
        check(Counter(lambda value: []), depth=1)
