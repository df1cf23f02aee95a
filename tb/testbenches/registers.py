"""Testbench of `hdl.registers`: a host on AXI4-Lite with pauses, and the machine's ports.

`tb.formal.host` proves START, ABORT, and events and errors that coincide with a write.
"""

import logging
import random
from dataclasses import dataclass, replace

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge
from cocotbext.axi import AxiLiteBus, AxiLiteMaster

from splatcore.sim.rtl.cocotb_runner import parameters
from splatcore.spec import registers
from splatcore.spec.axi import LITE_ADDRESS_BITS, OKAY, SLAVE_ERROR
from splatcore.spec.config import DEFAULT
from tb.helpers.streams import PERIOD, at_random, bursts, never, pause, reset, timed_test

CONFIG = replace(DEFAULT, address_bits=parameters()["address_bits"])
MAP, ADDRESS = registers.register_map(CONFIG), registers.addresses(CONFIG)
FRAME, COUNTERS = registers.frame_registers(CONFIG), registers.counter_registers(CONFIG)
PATTERNS = [never, at_random, bursts]
TIMEOUT = 60_000 * PERIOD
INPUTS = ("locked", "status", "ready_event", "frame_event", "error", "gives_up")
VALUES = ("counters", "needed", "started", "finished")
ANY = 0xFFFF_FFFF

logging.getLogger("cocotb").setLevel(logging.WARNING)  # the host logs every access


@dataclass
class Host:
    """Register accesses of software."""

    dut: object
    master: AxiLiteMaster
    starts: int = 0
    aborts: int = 0

    @classmethod
    async def begin(cls, dut, pattern) -> "Host":
        bus = AxiLiteBus.from_prefix(dut, "s_axi_")
        host = cls(dut, AxiLiteMaster(bus, dut.clk, dut.rst))
        pause(host.master.write_if, host.master.read_if, pattern)
        for name in (*INPUTS, *VALUES):
            getattr(dut, name).value = 0
        Clock(dut.clk, PERIOD, "ns").start(start_high=False)
        await reset(dut, 3)
        cocotb.start_soon(host.watch())
        return host

    async def watch(self):
        while True:
            await RisingEdge(self.dut.clk)
            self.starts += int(self.dut.start.value)
            self.aborts += int(self.dut.abort.value)

    async def write(self, address: int, value: int, size: int = registers.WORD) -> int:
        """Write a register; the response."""
        done = await self.master.write(address, value.to_bytes(registers.WORD, "little")[:size])
        return int(done.resp)

    async def read(self, address: int) -> tuple[int, int]:
        """Read a register; value and response."""
        done = await self.master.read(address, registers.WORD)
        return int.from_bytes(done.data, "little"), int(done.resp)

    async def put(self, name: str, value: int):
        assert await self.write(ADDRESS[name], value) == OKAY, name

    async def get(self, name: str) -> int:
        value, response = await self.read(ADDRESS[name])
        assert response == OKAY, name
        return value

    async def pulse(self, name: str, value: int = 1):
        getattr(self.dut, name).value = value
        await RisingEdge(self.dut.clk)
        getattr(self.dut, name).value = 0

    def frame(self) -> dict[str, int]:
        """The frame's registers, from the port to the machine."""
        value, found = int(self.dut.frame.value), {}
        for register in FRAME:
            found[register.name] = value % (1 << register.width)
            value >>= register.width
        return found


def error(code: registers.ErrorCode, detail: int = 0, halves: int = 0) -> int:
    return code | detail << registers.CODE_BITS | halves << registers.HALVES_AT


@timed_test(TIMEOUT, pattern=PATTERNS)
async def every_address_is_read(dut, pattern):
    """Registers return their values, other addresses 0 and an error."""
    host = await Host.begin(dut, pattern)
    values = {name: random.getrandbits(len(getattr(dut, name))) for name in VALUES}
    values["status"] = random.getrandbits(len(dut.status))
    for name, value in values.items():
        getattr(dut, name).value = value
    for k, register in enumerate(COUNTERS):
        values[register.name.lower()] = values["counters"] >> k * register.width & ANY
    for address in range(0, 1 << LITE_ADDRESS_BITS, registers.WORD):
        value, response = await host.read(address)
        register, right = MAP.get(address), 0
        if register is not None:
            named = values.get(register.name.lower(), 0)
            right = named if register.value is None else register.value
        assert value == right and response == (OKAY if register else SLAVE_ERROR), hex(address)


@timed_test(TIMEOUT, pattern=PATTERNS)
async def every_address_is_written(dut, pattern):
    """Writable registers hold the written values; nothing else changes."""
    host = await Host.begin(dut, pattern)
    assert not any(host.frame().values())
    expected = {}
    order = list(range(0, 1 << LITE_ADDRESS_BITS, registers.WORD))
    random.shuffle(order)
    for address in order:
        register, value = MAP.get(address), random.getrandbits(32)
        if register is None or register.access == "read":
            assert await host.write(address, value) == SLAVE_ERROR
        elif register.access == "frame":
            assert await host.write(address, random.getrandbits(16), random.randint(1, 3)) == 2
            assert await host.write(address, value) == OKAY
            assert await host.write(address, random.getrandbits(8), 1) == SLAVE_ERROR
            expected[register.name] = value % (1 << register.width)
    assert host.frame() == expected and len(expected) == len(FRAME)
    for name, value in expected.items():
        assert await host.get(name) == value
    assert await host.get("ERROR") == 0 and host.starts == host.aborts == 0


@timed_test(TIMEOUT, pattern=PATTERNS)
async def locked_registers_stay(dut, pattern):
    host = await Host.begin(dut, pattern)
    for register in FRAME:
        await host.put(register.name, ANY)
    before = host.frame()
    dut.locked.value = 1
    for number, register in enumerate(FRAME):
        assert await host.write(ADDRESS[register.name], 0) == SLAVE_ERROR
        assert await host.get("ERROR") == error(registers.ErrorCode.LOCKED, number)
        await host.put("ERROR", 0)
        assert await host.get("ERROR") == 0
    assert host.frame() == before
    dut.locked.value = 0
    await host.put(FRAME[0].name, 5)
    assert host.frame() == before | {FRAME[0].name: 5}


@timed_test(TIMEOUT, pattern=PATTERNS)
async def interrupts(dut, pattern):
    """Events set their bits, writing clears them, enabled ones raise the interrupt; ERROR has the
    halves that failed."""
    host = await Host.begin(dut, pattern)
    for halves in range(4):
        dut.gives_up.value = halves
        await host.pulse("error", 1 | error(registers.ErrorCode.READ, 3) << 1)
        dut.gives_up.value = 0
        assert await host.get("ERROR") == error(registers.ErrorCode.READ, 3, halves)
        await host.put("ERROR", 0)
        assert await host.get("ERROR") == 0
    await host.put("INTERRUPT", ANY)
    events = {
        registers.INTERRUPT_READY: ("ready_event", 1),
        registers.INTERRUPT_FRAME: ("frame_event", 1),
        registers.INTERRUPT_ERROR: ("error", 1 | error(registers.ErrorCode.READ, 1) << 1),
    }
    for bit, event in events.items():
        assert await host.get("INTERRUPT") == 0
        await host.pulse(*event)
        assert await host.get("INTERRUPT") == bit
        for enabled in range(8):
            await host.put("INTERRUPT_ENABLE", enabled)
            assert await host.get("INTERRUPT_ENABLE") == enabled
            assert dut.interrupt.value == bool(enabled & bit)
        await host.put("INTERRUPT", 7 & ~bit)
        assert await host.get("INTERRUPT") == bit
        await host.put("INTERRUPT", bit)
        assert dut.interrupt.value == 0


@timed_test(TIMEOUT, pattern=PATTERNS)
async def many_at_once(dut, pattern):
    """A host that does not wait for answers gets all of them, each its own."""
    host = await Host.begin(dut, pattern)
    names = [register.name for register in FRAME]
    values = {name: random.getrandbits(8) for name in names}
    read_only = ADDRESS["ID"]
    writes, reads = [], []
    for name, value in values.items():
        for address, right in ((ADDRESS[name], OKAY), (read_only, SLAVE_ERROR)):
            writes.append((cocotb.start_soon(host.write(address, value)), right))
    for task, right in writes:
        assert await task == right
    for name, value in values.items():
        for address, right in ((ADDRESS[name], (value, OKAY)), (0xFFC, (0, SLAVE_ERROR))):
            reads.append((cocotb.start_soon(host.read(address)), right))
    for task, right in reads:
        assert await task == right
