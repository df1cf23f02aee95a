"""Testbench of the whole machine without initial values: nothing unknown (X) leaves it after one
cycle of reset.

Parameters
    folder: of the cases (`tb.stages.table`)
    few: whether to render no frame
"""

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, RisingEdge

from splatcore.spec.registers import START, ErrorCode, split_error
from tb.helpers.stage_bench import FEW, OnMemory
from tb.helpers.streams import PERIOD, reset, timed_test

TIMEOUT = 300_000 * PERIOD
READY = "s_axi__awready s_axi__wready s_axi__arready m_axi__bready m_axi__rready".split()
PAYLOADS = {
    "s_axi__b": "resp", "s_axi__r": "data resp", "m_axi__ar": "id addr len size burst",
    "m_axi__aw": "id addr len size burst", "m_axi__w": "data strb last",
}  # fmt: skip
"""Payload signals of the channels that the machine drives."""

MIDDLE = (800, 1300, 1800)  # cycles of a frame after which the machine is reset
AFTERWARDS = 200  # cycles with a look at the outputs after the last access


async def watch(dut):
    """AssertionError when a control output or the payload of a valid one is unknown."""
    control = {name: getattr(dut, name) for name in (*READY, "interrupt")}
    valid = {channel: getattr(dut, f"{channel}valid") for channel in PAYLOADS}
    payload = {
        channel: {name: getattr(dut, channel + name) for name in names.split()}
        for channel, names in PAYLOADS.items()
    }
    while True:
        await RisingEdge(dut.clk)
        for name, signal in (control | valid).items():
            assert signal.value.is_resolvable, f"{name} is unknown"
        for channel, signals in payload.items():
            if int(valid[channel].value):
                for name, signal in signals.items():
                    assert signal.value.is_resolvable, f"{channel}{name} is {signal.value}"


async def begun(dut) -> OnMemory:
    """A bench; the machine has been reset for one cycle and is watched."""
    bench = OnMemory(dut, "free")
    Clock(dut.clk, PERIOD, "ns").start(start_high=False)
    await reset(dut, 1)
    cocotb.start_soon(watch(dut))
    await bench.begun()
    return bench


@timed_test(TIMEOUT)
async def nothing_is_set_up(dut):
    """START without any register of a frame is an error; the registers show 0."""
    bench = await begun(dut)
    host = bench.driver
    for name in ("STATUS", "STARTED", "FINISHED", "NEEDED", "WIDTH", "MODEL", "ERROR"):
        assert await host.read(name) == (name == "STATUS"), name
    await host.write("CONTROL", START)
    while not int(dut.interrupt.value):
        await RisingEdge(dut.clk)
    assert split_error(await host.read("ERROR")).code == ErrorCode.SIZE
    await reset(dut, 1)
    await ClockCycles(dut.clk, AFTERWARDS)
    assert await host.read("ERROR") == 0


@timed_test(TIMEOUT, case=[] if FEW else ["tie"])
async def a_frame_after_resets(dut, case):
    """A frame is right after one cycle of reset in the middle of earlier ones."""
    bench = await begun(dut)
    for cycles in MIDDLE:
        whole = cocotb.start_soon(bench.work([case]))
        await ClockCycles(dut.clk, cycles)
        assert not whole.done(), f"{case} ends before {cycles} cycles"
        whole.cancel()
        await reset(dut, 1)
        await bench.begun()
    await bench.work([case])
    await ClockCycles(dut.clk, AFTERWARDS)
