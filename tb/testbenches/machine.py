"""The testbench of `hdl.top`: AXI models that nobody here wrote, with pauses on all channels."""

import logging

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.triggers import RisingEdge, with_timeout
from cocotbext.axi import AxiBus, AxiLiteBus, AxiLiteMaster, AxiRam

from splatcore.golden.pipeline import render
from splatcore.sim.machine.areas import BASE, place_areas
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.sim.rtl.cocotb_runner import parameters
from splatcore.spec import registers
from splatcore.spec.config import TINY
from splatcore.spec.work import PIXEL, stride
from tb.helpers.machines import garden, view
from tb.helpers.streams import PERIOD, at_random, bursts, never, pause, reset

ADDRESS = registers.addresses(TINY)
PATTERNS = {"never": never, "at_random": at_random, "bursts": bursts}
TIMEOUT = 200_000 * PERIOD

logging.getLogger("cocotb").setLevel(logging.WARNING)


class Host:
    """A driver, as software would be."""

    def __init__(self, dut, pattern):
        self.dut = dut
        self.master = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axi_"), dut.clk, dut.rst)
        pause(self.master.write_if, self.master.read_if, pattern)

    async def write(self, name: str, value: int):
        await self.master.write(ADDRESS[name], value.to_bytes(registers.WORD, "little"))

    async def read(self, name: str) -> int:
        found = await self.master.read(ADDRESS[name], registers.WORD)
        return int.from_bytes(found.data, "little")

    async def start(self, values: dict[str, int]):
        for name, value in values.items():
            await self.write(name, value)
        await self.write("CONTROL", registers.START)

    async def wait(self, bit: int):
        """Until the interrupt has had that bit."""
        seen = 0
        while not seen & bit:
            while not int(self.dut.interrupt.value):
                await RisingEdge(self.dut.clk)
            found = await self.read("INTERRUPT")
            await self.write("INTERRUPT", found)
            seen |= found
            assert not seen & registers.INTERRUPT_ERROR, hex(await self.read("ERROR"))


@cocotb.test()
async def frames(dut):
    """Two frames from two cameras, the second one's points while the first is rendered."""
    pattern = PATTERNS[parameters()["pattern"]]
    model = garden(TINY, 60)
    jobs = [Job(model, view(34, 18, step)) for step in (0.0, 0.3)]
    areas = place_areas(TINY, [model], [(job.camera.width, job.camera.height) for job in jobs])
    size = 1 << (areas.end - BASE).bit_length()
    ram = AxiRam(AxiBus.from_prefix(dut, "m_axi_"), dut.clk, dut.rst, size=size)
    pause(ram.write_if, ram.read_if, pattern)
    ram.write(areas.models[0] - BASE, model.image.tobytes())
    host = Host(dut, pattern)
    Clock(dut.clk, PERIOD, "ns").start()
    await reset(dut, 3)
    events = registers.INTERRUPT_READY | registers.INTERRUPT_FRAME | registers.INTERRUPT_ERROR
    await host.write("INTERRUPT_ENABLE", events)

    def values(number: int) -> dict[str, int]:
        found = frame_values(TINY, jobs[number], 0, areas, number)
        moved = ("MODEL", "GROUPS", "LISTS", "FEATURES", "SCRATCH", "PIXELS")
        return found | {name: found[name] - BASE for name in moved}

    await with_timeout(host.start(values(0)), TIMEOUT, "ns")
    await with_timeout(host.wait(registers.INTERRUPT_READY), TIMEOUT, "ns")
    await with_timeout(host.start(values(1)), TIMEOUT, "ns")
    while await host.read("FINISHED") < len(jobs):
        await RisingEdge(dut.clk)
    for number, job in enumerate(jobs):
        camera = job.camera
        data = ram.read(areas.images[number] - BASE, stride(camera.width) * camera.height)
        rows = np.frombuffer(data, np.uint8).reshape(camera.height, -1)
        pixels = rows[:, : camera.width * PIXEL].reshape(camera.height, camera.width, PIXEL)
        assert np.array_equal(pixels, render(TINY, *job).pixels), f"frame {number}"
    assert await host.read("ERROR") == 0
