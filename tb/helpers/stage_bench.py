"""Stages under cocotb: between streams, or on a memory of `cocotbext-axi` with pauses.

A half of the machine is started by its ports, the whole machine by its registers.
"""

import json
import logging
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, RisingEdge
from cocotbext.axi import AxiBus, AxiLiteBus, AxiLiteMaster, AxiSlave

from splatcore.sim.rtl.cocotb_runner import parameters
from splatcore.spec import registers
from splatcore.spec.config import TINY
from tb.helpers.regions import Regions
from tb.helpers.streams import (
    PERIOD,
    Monitor,
    Stream,
    at_random,
    bursts,
    long_stalls,
    mostly,
    never,
    pause,
    receive,
    reset,
    send,
)

FOLDER = Path(parameters()["folder"])
FEW = parameters()["few"]
CASES = json.loads((FOLDER / "cases.json").read_text())
ADDRESS = registers.addresses(TINY)
PATTERNS = {
    "free": (never, never),
    "starved": (mostly, never),
    "blocked": (never, long_stalls),
    "bursts": (bursts, bursts),
    "random": (at_random, at_random),
}
"""Idle pattern of input streams and stall pattern of output streams; on memory pauses of the read
channels and of the write channels."""

SHORT = ("tie", "empty")
"""Cases with few cycles."""

IDLE_MAX = 10_000  # cycles without output after which a stage counts as hung
TAIL = 64  # cycles after the last expected row, to detect additional rows
SETTLING = 4  # cycles between setting other inputs and starting a frame
EVENTS = registers.INTERRUPT_READY | registers.INTERRUPT_FRAME | registers.INTERRUPT_ERROR

logging.getLogger("cocotb").setLevel(logging.WARNING)  # the memory logs every burst


class Bench:
    """A stage, its cases, and the cycles since the beginning."""

    def __init__(self, dut, pattern: str):
        self.dut, self.pattern, self.cycles, self.tasks = dut, pattern, 0, []

    async def begin(self):
        self.silence()
        Clock(self.dut.clk, PERIOD, "ns").start(start_high=False)
        await reset(self.dut, 3)
        cocotb.start_soon(self.count())
        await self.begun()

    async def count(self):
        while True:
            await RisingEdge(self.dut.clk)
            self.cycles += 1

    async def interrupt(self, name: str, cycles: int):
        """Work on a case for some cycles, then reset."""
        whole = cocotb.start_soon(self.work([name]))
        await ClockCycles(self.dut.clk, cycles)
        for task in (whole, *self.tasks):
            task.cancel()
        self.silence()
        await reset(self.dut, random.randint(1, 3))
        await self.begun()

    async def check(self, names: list[str], label: str) -> int:
        """Run cases one after the other and compare all results. Returns the cycles."""
        before = self.cycles
        given, taken = await self.work(names, f"{label}, {self.pattern}: ")
        passed = self.cycles - before
        with (FOLDER / "summary").open("a") as summary:
            line = f"{label}, {self.pattern}: {given} in, {taken} out, {passed} cycles"
            print(line, file=summary)
        return passed

    def row(self) -> list[str]:
        """The cases of a run in a row."""
        return [*CASES, *([] if FEW else reversed(CASES))]


class OnStreams(Bench):
    """A stage between streams."""

    def __init__(self, dut, pattern: str):
        super().__init__(dut, pattern)
        one = next(iter(CASES.values()))
        self.sources = {name: Stream(dut, name) for name in one["inputs"]}
        self.sinks = {name: Stream(dut, name) for name in one["expected"]}
        self.monitors = {name: Monitor(sink) for name, sink in self.sinks.items()}
        self.constants(one)
        for monitor in self.monitors.values():
            cocotb.start_soon(monitor.watch())

    def constants(self, case: dict):
        for name, value in case["constants"].items():
            port = getattr(self.dut, name)
            port.value = value % (1 << len(port))

    def silence(self):
        for stream in self.sources.values():
            stream.valid.value = stream.payload.value = 0
        self.take(0)

    def take(self, ready: int):
        for sink in self.sinks.values():
            sink.ready.value = ready

    async def begun(self):
        pass

    async def watch(self):
        """AssertionError if there is no output for IDLE_MAX cycles."""
        came = None
        while True:
            await ClockCycles(self.dut.clk, IDLE_MAX)
            before, came = came, {k: len(one.payloads) for k, one in self.monitors.items()}
            assert came != before, f"no output for {IDLE_MAX} cycles; items so far: {came}"

    async def work(self, names: list[str], label: str = "") -> tuple[str, str]:
        """Send all inputs of the cases and compare all outputs."""
        for monitor in self.monitors.values():
            monitor.payloads.clear()
        watch = cocotb.start_soon(self.watch())
        try:
            for name in names:
                await self.frame(CASES[name])
        finally:
            watch.cancel()
        self.take(1)
        await ClockCycles(self.dut.clk, TAIL)
        self.take(0)
        return self.compare(names, label)

    async def frame(self, case: dict):
        """Send all inputs and receive all outputs of a frame."""
        idle, stall = PATTERNS[self.pattern]
        self.constants(case)
        await ClockCycles(self.dut.clk, SETTLING)
        for name in case["first"]:
            await send(self.sources[name], case["inputs"][name])
        works = [
            send(self.sources[name], rows, idle())
            for name, rows in case["inputs"].items()
            if name not in case["first"]
        ]
        works += [
            receive(self.sinks[k], len(rows), stall()) for k, rows in case["expected"].items()
        ]
        self.tasks = [*map(cocotb.start_soon, works)]
        for task in self.tasks:
            await task

    def compare(self, names: list[str], label: str) -> tuple[str, str]:
        for stream, monitor in self.monitors.items():
            rows = [row for name in names for row in expected(CASES[name], stream)]
            for k, (found, (right, care)) in enumerate(zip(monitor.payloads, rows, strict=False)):
                message = f"{label}{stream}, item {k} is {found:#x}, not {right:#x}"
                assert not (found ^ right) & care, message
            count = len(monitor.payloads)
            assert count == len(rows), f"{label}{stream} has {count} items, not {len(rows)}"
        given = sum(len(rows) for name in names for rows in CASES[name]["inputs"].values())
        taken = sum(len(monitor.payloads) for monitor in self.monitors.values())
        return f"{given} items", f"{taken}"


def expected(case: dict, stream: str) -> list[tuple[int, int]]:
    """Expected payloads of an output stream, each with a mask of the bits that matter."""
    rows = case["expected"][stream]
    return list(zip(rows, case["care"].get(stream, [-1] * len(rows)), strict=True))


class OnMemory(Bench):
    """A stage, its memory, and its driver."""

    def __init__(self, dut, pattern: str):
        super().__init__(dut, pattern)
        self.driver = (Host if hasattr(dut, "s_axi__awvalid") else Half)(dut, pattern)
        self.memory = Regions(next(iter(CASES.values()))["regions"])
        slave = AxiSlave(AxiBus.from_prefix(dut, "m_axi_"), dut.clk, dut.rst, self.memory)
        pause(slave.write_if, slave.read_if, *PATTERNS[pattern])
        self.silence, self.begun = self.driver.silence, self.driver.begin
        cocotb.start_soon(self.memory.watch())

    def row(self) -> list[str]:
        return list(SHORT if FEW else CASES)

    def put(self, name: str):
        """Write a frame's input to memory, and wrong bytes where its results belong."""
        for address, given in CASES[name]["after"]:
            self.memory.put(address, bytes(byte ^ 0xFF for byte in bytes.fromhex(given)))
        for address, given in CASES[name]["before"]:
            self.memory.put(address, bytes.fromhex(given))

    def compare(self, name: str):
        for address, given in CASES[name]["after"]:
            found, right = self.memory.get(address, len(given) // 2), bytes.fromhex(given)
            wrong = [k for k, (a, b) in enumerate(zip(found, right, strict=True)) if a != b]
            assert not wrong, (
                f"{name}: {len(wrong)} of {len(right)} bytes at {address:#x} differ, first "
                f"{wrong[0]}: {found[wrong[0]]:#x}, not {right[wrong[0]]:#x}"
            )

    async def work(self, names: list[str], label: str = "") -> tuple[str, str]:
        await self.driver.work(names, self)
        given, taken = (
            sum(len(part) // 2 for name in names for _, part in CASES[name][way])
            for way in ("before", "after")
        )
        return f"{given} bytes", f"{taken}"


class Half:
    """A half of the machine, started by its ports."""

    def __init__(self, dut, pattern: str):
        self.dut = dut
        self.set_ports(next(iter(CASES)))

    def set_ports(self, name: str):
        for port, value in CASES[name]["ports"].items():
            getattr(self.dut, port).value = value

    def silence(self):
        self.dut.start.value = 0
        if hasattr(self.dut, "taken"):
            self.dut.taken.value = 0

    async def begin(self):
        pass

    async def work(self, names: list[str], bench: OnMemory):
        """Run frames one after the other; compare each one's results before the next begins."""
        for name in names:
            self.set_ports(name)
            bench.put(name)
            await ClockCycles(self.dut.clk, SETTLING)
            await self.pulse(self.dut.start)
            while not self.dut.done.value:
                await RisingEdge(self.dut.clk)
            if hasattr(self.dut, "taken"):
                await self.pulse(self.dut.taken)
            bench.compare(name)

    async def pulse(self, port):
        port.value = 1
        await RisingEdge(self.dut.clk)
        port.value = 0
        await RisingEdge(self.dut.clk)


class Host:
    """A driver of the whole machine, like software."""

    def __init__(self, dut, pattern: str):
        self.dut = dut
        self.master = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axi_"), dut.clk, dut.rst)
        pause(self.master.write_if, self.master.read_if, *PATTERNS[pattern])

    def silence(self):
        pass

    async def begin(self):
        await self.write("INTERRUPT_ENABLE", EVENTS)

    async def write(self, name: str, value: int):
        await self.master.write(ADDRESS[name], value.to_bytes(registers.WORD, "little"))

    async def read(self, name: str) -> int:
        found = await self.master.read(ADDRESS[name], registers.WORD)
        return int.from_bytes(found.data, "little")

    async def wait(self, bit: int):
        """Wait until INTERRUPT has had a bit."""
        seen = 0
        while not seen & bit:
            while not int(self.dut.interrupt.value):
                await RisingEdge(self.dut.clk)
            found = await self.read("INTERRUPT")
            await self.write("INTERRUPT", found)
            seen |= found
            assert not seen & registers.INTERRUPT_ERROR, hex(await self.read("ERROR"))

    async def work(self, names: list[str], bench: OnMemory):
        """Start each frame as soon as the machine is ready, while the previous one is rendered;
        compare all results at the end."""
        finished = await self.read("FINISHED") + len(names)
        for name in names:
            bench.put(name)
        for name in names:
            for register, value in CASES[name]["registers"].items():
                await self.write(register, value)
            await self.write("CONTROL", registers.START)
            await self.wait(registers.INTERRUPT_READY)
        while await self.read("FINISHED") < finished:
            await RisingEdge(self.dut.clk)
        assert await self.read("ERROR") == 0
        for name in names:
            bench.compare(name)
