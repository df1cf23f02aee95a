"""Streams in testbenches: send, receive, watch, stall, and payloads as integers.

For components whose streams carry one vector (`i__payload`, `i__valid`, `i__ready`), under
cocotb's `Clock`, with which a read after a rising edge sees the values before it.

A stall pattern is an endless iterator over cycles, true where the side that has it does nothing.
It draws from Python's `random`, which cocotb seeds anew for each test.

Nothing here gives up: a test says itself when (`timeout_time`), or a lost item is awaited for ever.
"""

import random
from collections.abc import Callable, Iterable, Iterator
from itertools import cycle, repeat

import cocotb
import numpy as np
from cocotb.clock import Clock
from cocotb.handle import SimHandleBase
from cocotb.triggers import ClockCycles, RisingEdge

from splatcore.spec.record import Codes, Record

PERIOD = 10  # clock period in ns; nothing depends on it

RESET_CYCLES = 2

STALL_MAX = 200  # longest run of stalled cycles in `long_stalls`
BURST_MAX = 12  # longest run of equal cycles in `bursts`: longer than any small queue is deep


def never() -> Iterator[bool]:
    return repeat(False)


def always() -> Iterator[bool]:
    """For what must happen, or not, while the other side gives nothing or takes nothing."""
    return repeat(True)


def alternate() -> Iterator[bool]:
    return cycle([True, False])


def at_random(p: float = 0.5) -> Iterator[bool]:
    """Each cycle with probability p."""
    while True:
        yield random.random() < p


def bursts() -> Iterator[bool]:
    """Runs of stalled and of free cycles by turns, each of random length."""
    stalled = random.random() < 0.5
    while True:
        yield from repeat(stalled, random.randint(1, BURST_MAX))
        stalled = not stalled


def long_stalls() -> Iterator[bool]:
    """Runs of stalled cycles in which whatever queue there is fills, and shorter ones of free
    cycles."""
    while True:
        yield from repeat(True, random.randint(1, STALL_MAX))
        yield from repeat(False, random.randint(1, BURST_MAX))


def mostly() -> Iterator[bool]:
    return at_random(0.8)


STALLS = [never, alternate, at_random, mostly, bursts]
"""The patterns that every case is crossed with, on both sides; `always` is for cases of its own."""


def pause(
    writing,
    reading,
    read: Callable[[], Iterator[bool]],
    write: Callable[[], Iterator[bool]] | None = None,
) -> None:
    """Pauses on all channels of the two sides of one of cocotbext-axi's models; write: on those by
    which is written, if not the same."""
    for side, names, pattern in (
        (writing, ("aw", "w", "b"), write or read),
        (reading, ("ar", "r"), read),
    ):
        for name in names:
            getattr(side, f"{name}_channel").set_pause_generator(pattern())


def timed_test(timeout: int, **parameters: Iterable) -> Callable:
    """Decorates a test: it runs with each value of the parameters, for `timeout` ns at most."""
    limited = cocotb.test(timeout_time=timeout, timeout_unit="ns")
    return lambda function: limited(cocotb.parametrize(**parameters)(function))


class Stream:
    """The ports of one stream, by the name before `__payload`: "i", "queue__o", "fork__o__1"."""

    def __init__(self, dut: SimHandleBase, name: str):
        self.name = name
        self.clk, self.rst = dut.clk, dut.rst
        self.payload = getattr(dut, f"{name}__payload")
        self.valid = getattr(dut, f"{name}__valid")
        self.ready = getattr(dut, f"{name}__ready")

    def passes(self) -> bool:
        """True if an item passes at the edge just seen."""
        return bool(self.valid.value) and bool(self.ready.value)


async def start(dut: SimHandleBase, sources: list[Stream], sinks: list[Stream]) -> None:
    """Start the clock and reset, all streams silent. Returns just after an edge."""
    for stream in sources:
        stream.valid.value = 0
        stream.payload.value = 0
    for stream in sinks:
        stream.ready.value = 0
    Clock(dut.clk, PERIOD, "ns").start()
    await reset(dut, RESET_CYCLES)


async def reset(dut: SimHandleBase, cycles: int = 1) -> None:
    """Hold reset for some cycles. Returns just after the last edge that sees it."""
    dut.rst.value = 1
    await ClockCycles(dut.clk, cycles)
    dut.rst.value = 0


async def send(stream: Stream, payloads: list[int], idle: Iterator[bool] | None = None) -> None:
    """Send payloads in order, a cycle's pause wherever `idle` says so.

    While valid is low the payload is noise, so that a component that looks at it is found out.
    """
    idle = idle or never()
    width = len(stream.payload)
    for payload in payloads:
        while next(idle):
            stream.valid.value = 0
            stream.payload.value = random.getrandbits(width)
            await RisingEdge(stream.clk)
        stream.valid.value = 1
        stream.payload.value = payload
        await RisingEdge(stream.clk)
        while not stream.ready.value:
            await RisingEdge(stream.clk)
    stream.valid.value = 0
    stream.payload.value = random.getrandbits(width)


async def receive(stream: Stream, count: int, stall: Iterator[bool] | None = None) -> list[int]:
    """Take `count` payloads; ready is low in a cycle in which `stall` says so."""
    stall = stall or never()
    payloads = []
    while len(payloads) < count:
        ready = not next(stall)
        stream.ready.value = ready
        await RisingEdge(stream.clk)
        if ready and stream.valid.value:
            payloads.append(int(stream.payload.value))
    stream.ready.value = 0
    return payloads


class Monitor:
    """Records what passes on a stream and asserts that an offer, once made, is kept.

    payloads, cycles: what passed and when, in cycles since `watch` began. Monitors that begin
    together count alike. Start it by `cocotb.start_soon(monitor.watch())`.
    """

    def __init__(self, stream: Stream):
        self.stream = stream
        self.payloads: list[int] = []
        self.cycles: list[int] = []

    def clear(self) -> None:
        """Forget what has passed."""
        self.payloads, self.cycles = [], []

    async def watch(self) -> None:
        stream, offered, now = self.stream, None, 0
        while True:
            await RisingEdge(stream.clk)
            payload = int(stream.payload.value) if stream.valid.value else None
            if offered is not None and not stream.rst.value:
                assert payload is not None, f"{stream.name}: valid fell before ready came"
                assert payload == offered, f"{stream.name}: payload changed before ready came"
            if stream.rst.value:
                offered = None
            elif stream.passes():
                self.payloads.append(payload)
                self.cycles.append(now)
                offered = None
            else:
                offered = payload
            now += 1


def words(record: Record, codes: Codes) -> list[int]:
    """Codes of N records as N payloads."""
    return [int.from_bytes(packed.tobytes(), "little") for packed in record.pack(codes)]


def codes(record: Record, words: list[int]) -> Codes:
    """The inverse of `words`."""
    packed = b"".join(word.to_bytes(record.size, "little") for word in words)
    return record.unpack(np.frombuffer(packed, np.uint8).reshape(-1, record.size))
