"""A simulated board: its UART is a serial port of this computer, until a file `end` exists."""

import os
import tty
from contextlib import suppress
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles
from cocotbext.uart import UartSink, UartSource

from splatcore.sim.rtl.cocotb_runner import parameters

CHARACTERS, BITS = 4, 10  # polling interval in characters; bits per character, start and stop incl.


@cocotb.test()
async def serve(dut):
    at = parameters()
    baud = at["baud"]
    pause = CHARACTERS * BITS * at["clock_hz"] // baud  # cycles
    Clock(dut.sys_clk, round(1e9 / at["clock_hz"]), "ns").start()
    dut.sys_rst.value, dut.serial_rx.value = 1, 1
    await ClockCycles(dut.sys_clk, 8)
    dut.sys_rst.value = 0
    source, sink = UartSource(dut.serial_rx, baud), UartSink(dut.serial_tx, baud)
    here, port = os.openpty()
    tty.setraw(port)
    os.set_blocking(here, False)
    Path(at["port"]).write_text(os.ttyname(port))
    while not Path(at["end"]).exists():
        await ClockCycles(dut.sys_clk, pause)
        if source.idle():
            with suppress(BlockingIOError):
                await source.write(os.read(here, 256))
        if not sink.empty():
            os.write(here, sink.read_nowait())
