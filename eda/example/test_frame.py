"""A host and a memory for the machine: render one frame and compare it with expected.png."""

import json
import logging
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, RisingEdge
from cocotbext.axi import AxiBus, AxiLiteBus, AxiLiteMaster, AxiRam
from PIL import Image

HERE = Path(__file__).resolve().parent
FRAME = json.loads((HERE / "frame.json").read_text())
READY, START, FRAME_DONE, ERROR = 1, 1, 2, 4  # bits of STATUS, CONTROL and INTERRUPT
CYCLES = 10_000  # limit; the frame takes about a quarter


class Host:
    """Registers by name over AXI4-Lite."""

    def __init__(self, dut):
        bus = AxiLiteBus.from_prefix(dut, "s_axi_")
        self.master = AxiLiteMaster(bus, dut.clk, dut.rst)

    async def read(self, name: str) -> int:
        found = await self.master.read(FRAME["addresses"][name], 4)
        return int.from_bytes(found.data, "little")

    async def write(self, name: str, value: int):
        await self.master.write(FRAME["addresses"][name], value.to_bytes(4, "little"))


def picture(memory: AxiRam) -> Image.Image:
    """The image in memory."""
    of = FRAME["image"]
    row = of["width"] * of["pixel"]
    rows = [memory.read(of["at"] + y * of["stride"], row) for y in range(of["height"])]
    return Image.frombytes("RGB", (of["width"], of["height"]), b"".join(map(bytes, rows)))


async def cycles_until_interrupt(dut) -> int:
    for cycle in range(CYCLES):
        await RisingEdge(dut.clk)
        if dut.interrupt.value == 1:
            return cycle
    raise AssertionError(f"no interrupt in {CYCLES} cycles")


@cocotb.test()
async def frame(dut):
    """Reset, load the model, write registers, START, wait for the interrupt, compare pictures."""
    logging.getLogger("cocotb").setLevel(logging.WARNING)  # the memory logs every burst
    (HERE / "frame.png").unlink(missing_ok=True)
    dut.rst.value = 1
    Clock(dut.clk, 2, "ns").start()
    host = Host(dut)
    bus = AxiBus.from_prefix(dut, "m_axi_")
    memory = AxiRam(bus, dut.clk, dut.rst, size=FRAME["memory"])
    memory.write(FRAME["registers"]["MODEL"], (HERE / "model.splatcore").read_bytes())
    await ClockCycles(dut.clk, 4)
    dut.rst.value = 0

    assert await host.read("ID") == int.from_bytes(b"SPLT", "little")
    assert await host.read("STATUS") & READY
    for name, value in FRAME["registers"].items():
        await host.write(name, value)
    await host.write("INTERRUPT_ENABLE", FRAME_DONE | ERROR)
    await host.write("CONTROL", START)
    cycles = await cycles_until_interrupt(dut)
    error = await host.read("ERROR")
    assert error == 0, f"ERROR is {error:#x}"

    found = picture(memory)
    found.save(HERE / "frame.png")
    with Image.open(HERE / "expected.png") as right:
        assert found.tobytes() == right.convert("RGB").tobytes(), "frame.png is not expected.png"
    print(f"one frame in {cycles} cycles: frame.png equals expected.png")
