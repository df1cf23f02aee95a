"""Testbench of a stage: its cases with stalls, all in a row, and after resets at any time.

Parameters
    folder: of the cases (`tb.stages.table`); its file `summary` gets one line per run
    few: whether to do few runs
"""

import random

from tb.helpers.stage_bench import CASES, FEW, PATTERNS, OnMemory, OnStreams
from tb.helpers.streams import PERIOD, timed_test

TIMEOUT = 300_000 * PERIOD
STREAMS = "inputs" in next(iter(CASES.values()))
Bench = OnStreams if STREAMS else OnMemory
ROW = ["bursts"] if FEW else ["free", "bursts", *["random"] * (not STREAMS)]
RESET = ["bursts"] if FEW or not STREAMS else ["free", "bursts"]
RESETS = 1 if FEW else 4 if STREAMS else 2


@timed_test(TIMEOUT, case=[] if FEW else list(CASES), pattern=[*PATTERNS][: 4 if STREAMS else 3])
async def each_case(dut, case, pattern):
    """All results are right, and offers are kept."""
    bench = Bench(dut, pattern)
    await bench.begin()
    await bench.check([case], case)


@timed_test(TIMEOUT, pattern=ROW)
async def frames_in_a_row(dut, pattern):
    """All cases, without a reset in between: no state remains from the previous case."""
    bench = Bench(dut, pattern)
    await bench.begin()
    await bench.check(bench.row(), "in a row")


@timed_test(TIMEOUT, pattern=[] if FEW and not STREAMS else RESET)
async def reset_in_the_middle(dut, pattern):
    """After a reset at any time no state remains."""
    bench, case = Bench(dut, pattern), "full"
    await bench.begin()
    cycles = await bench.check([case], "before a reset")
    for _ in range(RESETS):
        await bench.interrupt(case, random.randint(1, cycles))
        await bench.check([case], "after a reset")
