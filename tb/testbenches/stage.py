"""Testbench of a stage without memory: send its input rows with stalls and compare its output rows
bit by bit; with and without a reset between cases.

Parameters
    folder: of the cases (`tb.helpers.feeds`); its file `summary` gets one line per run
    few: whether to do few runs
"""

import json
import random
from collections.abc import Iterable
from pathlib import Path

import cocotb
from cocotb.triggers import ClockCycles, RisingEdge

from splatcore.sim.rtl.cocotb_runner import parameters
from tb.helpers.streams import (
    PERIOD,
    Monitor,
    Stream,
    bursts,
    long_stalls,
    mostly,
    never,
    receive,
    reset,
    send,
    start,
    timed_test,
)

FOLDER = Path(parameters()["folder"])
FEW = parameters()["few"]
CASES = json.loads((FOLDER / "cases.json").read_text())
CYCLES_MAX = 200_000
PATTERNS = {
    "free": (never, never),
    "starved": (mostly, never),
    "blocked": (never, long_stalls),
    "bursts": (bursts, bursts),
}
"""Idle pattern of input streams and stall pattern of output streams."""

IDLE_MAX = 10_000  # cycles without output after which the stage counts as hung
RESETS = 1 if FEW else 4
TAIL = 64  # cycles after the last expected row, to detect additional rows
SETTLING = 2  # cycles between setting other inputs and starting a frame


def some(patterns: Iterable[str]) -> list[str]:
    """These patterns, or only "bursts" if few runs are wanted."""
    return ["bursts"] if FEW else list(patterns)


class Bench:
    """A stage between streams."""

    def __init__(self, dut):
        self.dut = dut
        one = next(iter(CASES.values()))
        self.sources = {name: Stream(dut, name) for name in one["inputs"]}
        self.sinks = {name: Stream(dut, name) for name in one["expected"]}
        self.monitors = {name: Monitor(sink) for name, sink in self.sinks.items()}

    async def begin(self):
        self.constants(next(iter(CASES.values())))
        await start(self.dut, [*self.sources.values()], [*self.sinks.values()])
        for monitor in self.monitors.values():
            cocotb.start_soon(monitor.watch())

    def constants(self, feed: dict):
        for name, value in feed["constants"].items():
            port = getattr(self.dut, name)
            port.value = value % (1 << len(port))

    async def work(self, feed: dict, pattern: str):
        """Send all inputs and receive all outputs of a frame."""
        idle, stall = PATTERNS[pattern]
        self.constants(feed)
        await ClockCycles(self.dut.clk, SETTLING)
        for name in feed["first"]:
            await send(self.sources[name], feed["inputs"][name])
        works = [
            send(self.sources[name], rows, idle())
            for name, rows in feed["inputs"].items()
            if name not in feed["first"]
        ]
        works += [
            receive(self.sinks[k], len(rows), stall()) for k, rows in feed["expected"].items()
        ]
        self.tasks = [*map(cocotb.start_soon, works)]
        for task in self.tasks:
            await task

    async def interrupt(self, feed: dict, pattern: str, cycles: int):
        """Do the same for some cycles, then reset."""
        self.tasks = []
        whole = cocotb.start_soon(self.work(feed, pattern))
        await ClockCycles(self.dut.clk, cycles)
        for task in (whole, *self.tasks):
            task.cancel()
        for stream in self.sources.values():
            stream.valid.value = 0
        for stream in self.sinks.values():
            stream.ready.value = 0
        await reset(self.dut, random.randint(1, 3))

    async def check(self, names: list[str], pattern: str, label: str) -> int:
        """Run cases one after the other and compare all outputs. Returns the cycles."""
        for monitor in self.monitors.values():
            monitor.clear()
        task = cocotb.start_soon(self.count())
        for name in names:
            await self.work(CASES[name], pattern)
        task.cancel()
        for sink in self.sinks.values():
            sink.ready.value = 1
        await ClockCycles(self.dut.clk, TAIL)
        for sink in self.sinks.values():
            sink.ready.value = 0
        self.compare(names, f"{label}, {pattern}")
        return self.passed

    async def count(self):
        """Count cycles; AssertionError if there is no output for IDLE_MAX cycles."""
        self.passed, last, came = 0, 0, {}
        while True:
            await RisingEdge(self.dut.clk)
            self.passed += 1
            if self.passed - last == IDLE_MAX:
                before, last = came, self.passed
                came = {name: len(monitor.payloads) for name, monitor in self.monitors.items()}
                assert came != before, f"no output for {IDLE_MAX} cycles; items so far: {came}"

    def compare(self, names: list[str], label: str):
        for stream, monitor in self.monitors.items():
            rows = [row for name in names for row in expected(CASES[name], stream)]
            for k, (found, (right, care)) in enumerate(zip(monitor.payloads, rows, strict=False)):
                assert not (found ^ right) & care, (
                    f"{label}: {stream}, item {k} is {found:#x}, not {right:#x}"
                )
            count = len(monitor.payloads)
            assert count == len(rows), f"{label}: {stream} has {count} items, not {len(rows)}"
        given = sum(len(rows) for name in names for rows in CASES[name]["inputs"].values())
        taken = sum(len(monitor.payloads) for monitor in self.monitors.values())
        with (FOLDER / "summary").open("a") as summary:
            print(f"{label}: {given} items in, {taken} out, {self.passed} cycles", file=summary)


def expected(feed: dict, stream: str) -> list[tuple[int, int]]:
    """Expected payloads of an output stream, each with a mask of the bits that matter."""
    rows = feed["expected"][stream]
    return list(zip(rows, feed["care"].get(stream, [-1] * len(rows)), strict=True))


@timed_test(CYCLES_MAX * PERIOD, case=[] if FEW else list(CASES), pattern=list(PATTERNS))
async def each_case(dut, case, pattern):
    """All items come out in order, and offers are kept."""
    bench = Bench(dut)
    await bench.begin()
    await bench.check([case], pattern, case)


@timed_test(CYCLES_MAX * PERIOD, pattern=some(["free", "bursts"]))
async def frames_in_a_row(dut, pattern):
    """All cases twice without a reset in between: no state remains from the previous case."""
    bench = Bench(dut)
    await bench.begin()
    again = [] if FEW else reversed(CASES)
    await bench.check([*CASES, *again], pattern, "in a row")


@timed_test(CYCLES_MAX * PERIOD, pattern=some(["free", "bursts"]))
async def reset_in_the_middle(dut, pattern):
    """After a reset at any time no state remains."""
    bench, case = Bench(dut), "full"
    await bench.begin()
    cycles = await bench.check([case], pattern, "before a reset")
    for _ in range(RESETS):
        await bench.interrupt(CASES[case], pattern, random.randint(1, cycles))
        await bench.check([case], pattern, "after a reset")
