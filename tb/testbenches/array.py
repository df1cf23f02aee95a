"""The bench of `hdl.points.array`: a program's items under stalls on both sides.

Parameters: the folder with `fields`, `constants` and `outputs` as rows of packed records.
"""

from pathlib import Path

import cocotb
import numpy as np
from cocotb.triggers import Combine

from splatcore.sim.rtl.cocotb_runner import parameters
from tb.helpers.streams import PERIOD, STALLS, Monitor, Stream, receive, send, start

FOLDER = Path(parameters()["folder"])
INTERVAL = parameters()["interval"]


def rows(name: str) -> list[int]:
    """Packed records as integers."""
    return [int.from_bytes(row.tobytes(), "little") for row in np.load(FOLDER / f"{name}.npy")]


@cocotb.test(timeout_time=400 * INTERVAL * PERIOD * 20, timeout_unit="ns")
@cocotb.parametrize(idle=STALLS, stall=STALLS)
async def every_output_is_right(dut, idle, stall):
    """All items come out in order, every bit, held while they are not taken."""
    source, sink = Stream(dut, "i"), Stream(dut, "o")
    await start(dut, [source], [sink])
    [dut.constants.value] = rows("constants")
    monitor = Monitor(sink)
    cocotb.start_soon(monitor.watch())
    expected = rows("outputs")
    sender = cocotb.start_soon(send(source, rows("fields"), idle()))
    receiver = cocotb.start_soon(receive(sink, len(expected), stall()))
    await Combine(sender, receiver)
    assert monitor.payloads == expected
