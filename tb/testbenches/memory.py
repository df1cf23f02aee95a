"""Testbench of stages on memory: `cocotbext-axi`'s memory, with pauses on its channels.

Parameters
    folder: of the cases (`tb.helpers.frame_cases`); its file `summary` gets one line per run
    few: whether to do few runs

A half of the machine is started by its ports, the whole machine by its registers.
"""

import json
import logging
import random
from collections.abc import Iterable
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, RisingEdge
from cocotbext.axi import AxiBus, AxiLiteBus, AxiLiteMaster, AxiRam

from splatcore.sim.rtl.cocotb_runner import parameters
from splatcore.spec import registers
from splatcore.spec.config import TINY
from tb.helpers.streams import (
    PERIOD,
    at_random,
    bursts,
    long_stalls,
    mostly,
    never,
    pause,
    reset,
    timed_test,
)

FOLDER = Path(parameters()["folder"])
FEW = parameters()["few"]
CASES = json.loads((FOLDER / "cases.json").read_text())
ADDRESS = registers.addresses(TINY)
TIMEOUT = 300_000 * PERIOD
PATTERNS = {
    "free": (never, never),
    "starved": (mostly, never),
    "blocked": (never, long_stalls),
    "random": (at_random, at_random),
    "bursts": (bursts, bursts),
}
"""Pauses of the read channels and of the write channels."""

SHORT = ("tie", "empty")
"""Cases with few cycles."""

RESETS = 2
SETTLING = 4  # cycles between setting a half's ports and starting its frame
EVENTS = registers.INTERRUPT_READY | registers.INTERRUPT_FRAME | registers.INTERRUPT_ERROR

logging.getLogger("cocotb").setLevel(logging.WARNING)  # the memory logs every burst


def some(patterns: Iterable[str]) -> list[str]:
    """These patterns, or only "bursts" if few runs are wanted."""
    return ["bursts"] if FEW else list(patterns)


class Half:
    """A half of the machine, started by its ports."""

    def __init__(self, dut, pattern: str):
        self.dut = dut
        self.set_ports(next(iter(CASES)))
        self.silence()

    def set_ports(self, name: str):
        for port, value in CASES[name]["ports"].items():
            getattr(self.dut, port).value = value

    def silence(self):
        self.dut.start.value = 0
        if hasattr(self.dut, "taken"):
            self.dut.taken.value = 0

    async def begin(self):
        pass

    async def work(self, names: list[str], bench: "Bench"):
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

    async def work(self, names: list[str], bench: "Bench"):
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


class Bench:
    """A stage, its memory, and its driver."""

    def __init__(self, dut, pattern: str):
        self.dut, self.pattern, self.cycles = dut, pattern, 0
        self.driver = (Host if hasattr(dut, "s_axi__awvalid") else Half)(dut, pattern)
        size = next(iter(CASES.values()))["memory"]
        self.ram = AxiRam(AxiBus.from_prefix(dut, "m_axi_"), dut.clk, dut.rst, size=size)
        pause(self.ram.write_if, self.ram.read_if, *PATTERNS[pattern])

    async def begin(self):
        Clock(self.dut.clk, PERIOD, "ns").start()
        await reset(self.dut, 3)
        cocotb.start_soon(self.count())
        await self.driver.begin()

    async def count(self):
        while True:
            await RisingEdge(self.dut.clk)
            self.cycles += 1

    def put(self, name: str):
        """Write a frame's input to memory, and wrong bytes where its results belong."""
        for address, given in CASES[name]["after"]:
            self.ram.write(address, bytes(byte ^ 0xFF for byte in bytes.fromhex(given)))
        for address, given in CASES[name]["before"]:
            self.ram.write(address, bytes.fromhex(given))

    def compare(self, name: str):
        for address, given in CASES[name]["after"]:
            right = bytes.fromhex(given)
            found = self.ram.read(address, len(right))
            wrong = [k for k, (a, b) in enumerate(zip(found, right, strict=True)) if a != b]
            assert not wrong, (
                f"{name}: {len(wrong)} of {len(right)} bytes at {address:#x} differ, first "
                f"{wrong[0]}: {found[wrong[0]]:#x}, not {right[wrong[0]]:#x}"
            )

    async def check(self, names: list[str], label: str) -> int:
        """Run cases one after the other. Returns the cycles."""
        before = self.cycles
        await self.driver.work(names, self)
        given, taken = (
            sum(len(part) // 2 for name in names for _, part in CASES[name][way])
            for way in ("before", "after")
        )
        passed = self.cycles - before
        with (FOLDER / "summary").open("a") as summary:
            line = f"{label}, {self.pattern}: {given} bytes in, {taken} out, {passed} cycles"
            print(line, file=summary)
        return passed


@timed_test(TIMEOUT, case=[] if FEW else list(CASES), pattern=["free", "starved", "blocked"])
async def each_case(dut, case, pattern):
    """Memory has the expected contents under all patterns of pauses."""
    bench = Bench(dut, pattern)
    await bench.begin()
    await bench.check([case], case)


@timed_test(TIMEOUT, pattern=some(["free", "random", "bursts"]))
async def frames_in_a_row(dut, pattern):
    """All cases without a reset in between: no state remains from the previous case."""
    bench = Bench(dut, pattern)
    await bench.begin()
    await bench.check(list(SHORT if FEW else CASES), "in a row")


@timed_test(TIMEOUT, pattern=[] if FEW else ["bursts"])
async def reset_in_the_middle(dut, pattern):
    """After a reset at any time no state remains."""
    bench, case = Bench(dut, pattern), "full"
    await bench.begin()
    cycles = await bench.check([case], "before a reset")
    for _ in range(RESETS):
        task = cocotb.start_soon(bench.driver.work([case], bench))
        await ClockCycles(dut.clk, random.randint(1, cycles))
        task.cancel()
        bench.driver.silence()
        await reset(dut, 3)
        await bench.driver.begin()
        await bench.check([case], "after a reset")
