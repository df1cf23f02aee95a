"""Testbench of `hdl.memory.axi`: traffic, errors, and halves that fail."""

import logging
import random

from cocotb.triggers import ClockCycles, RisingEdge

from splatcore.spec.axi import PREPROCESSING, RENDERING, WRITERS
from tb.helpers.axi_clients import BEAT, Bench
from tb.helpers.streams import PERIOD, at_random, bursts, mostly, never, timed_test

PATTERNS = [never, at_random, mostly, bursts]

ROUNDS, WAIT_MAX = 6, 60  # failures of a half; maximum cycles before each of them
TIMEOUT = 20_000 * PERIOD  # time limit of each test in ns

logging.getLogger("cocotb").setLevel(logging.WARNING)  # the memories log every burst


@timed_test(TIMEOUT, kind=["ram", "mixed"], pattern=PATTERNS)
async def traffic(dut, kind, pattern):
    """All data read and written are right."""
    bench = Bench(dut, kind, pattern)
    await bench.start()
    bench.load()
    await bench.done()
    bench.compare()
    assert bench.errors == {"read": set(), "write": set()}


@timed_test(TIMEOUT, pattern=[never, at_random])
async def errors(dut, pattern):
    """Errors are reported for exactly the clients that met one; other clients are not disturbed."""
    bench = Bench(dut, "mixed", pattern)
    await bench.start()
    bench.load()
    met = {"read": set(), "write": set()}
    for queues in (bench.requests, bench.beats):
        for client in random.sample(range(len(queues)), 2):
            bench.memory.broken.add(random.choice(queues[client])[0] * BEAT)
    for k, requests in enumerate(bench.requests):
        for first, beats in requests:
            if any((first + n) * BEAT in bench.memory.broken for n in range(beats)):
                met["read"].add(k)
    for k, beats in enumerate(bench.beats):
        if any((b[0] + b[1]) * BEAT in bench.memory.broken and b[3] for b in beats):
            met["write"].add(k)
    await bench.done()
    bench.compare()
    assert met["read"] and met["write"] and bench.errors == met


@timed_test(TIMEOUT, pattern=PATTERNS, half=[PREPROCESSING, RENDERING])
async def one_half_fails(dut, pattern, half):
    """A half that fails at any time becomes idle; the other half is not disturbed."""
    bench = Bench(dut, "mixed", pattern)
    await bench.start()
    bench.load((1 - half,))
    writers = [k for k, of in enumerate(WRITERS.values()) if of == half]
    for number in range(ROUNDS):
        bench.load((half,))
        await ClockCycles(dut.clk, random.randint(1, WAIT_MAX))
        while number == 0 and max(bench.inside[k] for k in writers) < 2:
            await RisingEdge(dut.clk)
        bench.silent[half] = random.random() < 0.5  # else they continue to offer
        dut.failing.value = 1 << half
        await ClockCycles(dut.clk, 2)
        assert number or any(bench.inside[k] for k in writers), "no burst was interrupted"
        while not int(dut.idle.value) >> half & 1:
            await RisingEdge(dut.clk)
        bench.silent[half] = True
        await ClockCycles(dut.clk, 2)
        bench.abort(half)
        dut.failing.value = 0
        bench.silent[half] = False
    bench.load((half,))
    await bench.done()
    assert (bench.content() == bench.expected).all()
