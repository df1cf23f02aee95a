"""Stream primitives under all stall patterns: order, latency, capacity and throughput in cycles."""

import gc

import pytest

from splatcore.hdl.lib.stream import MEMORY_DEPTH_MIN, Fork, Pipe, Queue, Register, Slot, Stage
from splatcore.sim.rtl.cocotb_runner import run_testbench
from tb.helpers.parts import Piped, SideBySide
from tb.helpers.runs import needs_icarus

WIDTH = 16


def part(component, latency: int, capacity: int, outputs: int = 1, pace: int = 1) -> tuple:
    """Return a component and its docstring's promises. pace: cycles per item"""
    level = hasattr(component, "level")
    promise = {"latency": latency, "capacity": capacity, "outputs": outputs, "level": level}
    promise["pace"] = pace
    return component, promise


PARTS = {
    "register": part(Register(WIDTH), 1, 2),
    "slot": part(Slot(WIDTH), 1, 1, pace=2),
    "stage": part(Stage(WIDTH), 1, 1),
    **{f"queue_{n}": part(Queue(WIDTH, n), 1, n) for n in (2, 5, 8)},
    **{f"memory_{n}": part(Queue(WIDTH, n, memory=True), 2, n) for n in (3, 8)},
    "fork": part(Fork(WIDTH, 3), 0, 0, outputs=3),
    **{f"pipe_{n}": part(Piped(WIDTH, n), n, n) for n in (1, 4)},
}


PROMISES = {name: promise for name, (_, promise) in PARTS.items()}


def run(simulator: str, promises: dict, few: bool):
    beside = SideBySide({name: component for name, (component, _) in PARTS.items()})
    run_testbench(beside, "tb.testbenches.stream", simulator=simulator, parts=promises, few=few)


@pytest.mark.slow
def test_under_verilator():
    run("verilator", PROMISES, few=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, promise, test",
    [
        ("pipe_4", "latency", "throughput"),
        ("slot", "pace", "throughput"),
        ("queue_5", "capacity", "capacity"),
    ],
)
def test_broken_promise_is_named(name, promise, test):
    """The testbench fails, and names test and part, if a promise is off by one."""
    broken = PROMISES[name] | {promise: PROMISES[name][promise] - 1}
    with pytest.raises(AssertionError, match=rf"tb\.testbenches\.stream\.{test}/part={name}"):
        run("verilator", {name: broken, "fork": PROMISES["fork"]}, few=True)


@needs_icarus
@pytest.mark.slow
def test_under_icarus():
    run("icarus", PROMISES, few=True)


@pytest.mark.filterwarnings("ignore::amaranth.hdl.UnusedElaboratable")
@pytest.mark.parametrize(
    "make",
    [
        lambda: Queue(8, 1),
        lambda: Queue(8, MEMORY_DEPTH_MIN - 1, memory=True),
        lambda: Fork(8, 0),
        lambda: Pipe(0),
    ],
)
def test_impossible_sizes(make):
    with pytest.raises(ValueError, match="below"):
        make()
    gc.collect()  # or Amaranth warns of the unused component during some other test
