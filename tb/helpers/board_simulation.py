"""A simulated board in a separate process; its UART is a serial port of this computer."""

import multiprocessing
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from splatcore.eda.board.system import simulated
from splatcore.eda.board.write import quiet, undated, write_facts
from splatcore.eda.deliver.verilog import NAMES, write_top
from splatcore.sim.rtl.cocotb_runner import public, run_sources
from splatcore.sim.rtl.verilator import without_initial
from splatcore.spec.config import Config

CLOCK_HZ, BAUD = 50_000_000, 6_250_000
PORTS = ["sys_clk", "sys_rst", "serial_tx", "serial_rx"]
COMPILING_SECONDS = 1800


@contextmanager
def simulated_board(config: Config, folder: Path) -> Iterator[str]:
    """Simulate a machine on a board; yields the name of its serial port.

    folder: gets `board.json`, and `log`, the simulation's output
    The machine's registers and memories have random initial values.
    """
    with quiet():
        system = simulated(config, CLOCK_HZ, BAUD, "MT48LC16M16")
        system.finalize()
        text = str(system.platform.get_verilog(system, name="top"))
    write_facts(folder, config, system, BAUD)
    write_top(config, folder / "rtl")
    sources = {name: without_initial((folder / "rtl" / name).read_text()) for name in NAMES.sources}
    sources |= {"top.v": undated(text), "top.vlt": public(PORTS)}
    port, end = folder / "port", folder / "end"
    about = {"log": folder / "log", "port": str(port), "end": str(end)}
    about |= {"clock_hz": CLOCK_HZ, "baud": BAUD}
    arguments = sources, "tb.testbenches.board", "verilator", 1
    process = multiprocessing.get_context("spawn").Process(
        target=run_sources, args=arguments, kwargs=about
    )
    process.start()
    try:
        yield opened(port, process)
    finally:
        end.touch()
        process.join()
    assert process.exitcode == 0


def opened(path: Path, process: multiprocessing.Process) -> str:
    """Wait for the port that a simulation opens when it is compiled."""
    until = time.monotonic() + COMPILING_SECONDS
    while process.is_alive() and time.monotonic() < until:
        if path.exists() and (port := path.read_text()):
            return port
        time.sleep(0.1)
    raise AssertionError("the simulation did not start")
