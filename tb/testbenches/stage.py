"""The testbench of a stage: rows of its in streams under stalls, rows of its out streams back.

Parameters: the folder with `in_NAME` and `out_NAME` as rows of packed records, the values of the
ports that stay, the streams that are through before the others begin.
"""

from pathlib import Path

import cocotb
import numpy as np
from cocotb.triggers import Combine

from splatcore.sim.rtl.cocotb_runner import parameters
from tb.helpers.streams import PERIOD, Monitor, Stream, bursts, never, receive, send, start

FOLDER = Path(parameters()["folder"])
CYCLES_MAX = 20_000


def rows(kind: str) -> dict[str, list[int]]:
    """Packed records as integers, by stream."""
    found = {}
    for path in sorted(FOLDER.glob(f"{kind}_*.npy")):
        numbers = [int.from_bytes(row.tobytes(), "little") for row in np.load(path)]
        found[path.stem.removeprefix(f"{kind}_")] = numbers
    return found


@cocotb.test(timeout_time=CYCLES_MAX * PERIOD, timeout_unit="ns")
@cocotb.parametrize(pattern=[never, bursts])
async def every_output_is_right(dut, pattern):
    """All items come out in order and are held while they are not taken.

    The result is left in `found_NAME`: what of it matters is known outside.
    """
    given, expected = rows("in"), rows("out")
    sources = {name: Stream(dut, name) for name in given}
    sinks = {name: Stream(dut, name) for name in expected}
    for name, value in parameters()["constants"].items():
        getattr(dut, name).value = value
    await start(dut, list(sources.values()), list(sinks.values()))
    monitors = {name: Monitor(sink) for name, sink in sinks.items()}
    for monitor in monitors.values():
        cocotb.start_soon(monitor.watch())
    for name in parameters()["first"]:
        await send(sources[name], given[name])
    rest = [name for name in sources if name not in parameters()["first"]]
    works = [send(sources[name], given[name], pattern()) for name in rest]
    works += [receive(sink, len(expected[name]), pattern()) for name, sink in sinks.items()]
    await Combine(*map(cocotb.start_soon, works))
    for name, monitor in monitors.items():
        size = np.load(FOLDER / f"out_{name}.npy").shape[1]
        packed = b"".join(payload.to_bytes(size, "little") for payload in monitor.payloads)
        path = FOLDER / f"found_{pattern.__name__}_{name}.npy"
        np.save(path, np.frombuffer(packed, np.uint8).reshape(-1, size))
