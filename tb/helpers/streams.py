"""Streams in testbenches: send, receive, watch, stall.

For components whose streams have ports `i__payload`, `i__valid` and `i__ready`, under cocotb's
`Clock`, with which a read after a rising edge sees the values before the edge.

A stall pattern is an endless iterator over cycles: true if its side of a stream idles. It draws
from Python's `random`, which cocotb seeds for each test.

These functions have no time limit: set `timeout_time` of the test, or it waits forever for a lost
item.
"""

import random
from collections.abc import Callable, Iterable, Iterator
from itertools import repeat

import cocotb
from cocotb.handle import SimHandleBase
from cocotb.triggers import ClockCycles, RisingEdge

PERIOD = 10  # clock period in ns; arbitrary

STALL_MAX = 200  # longest run of stalled cycles in `long_stalls`
BURST_MAX = 12  # longest run of equal cycles in `bursts`: longer than the depth of small queues


def never() -> Iterator[bool]:
    return repeat(False)


def at_random(p: float = 0.5) -> Iterator[bool]:
    """Stall in each cycle with probability p."""
    while True:
        yield random.random() < p


def bursts() -> Iterator[bool]:
    """Alternate runs of stalled and free cycles, each of random length."""
    stalled = random.random() < 0.5
    while True:
        yield from repeat(stalled, random.randint(1, BURST_MAX))
        stalled = not stalled


def long_stalls() -> Iterator[bool]:
    """Alternate runs of stalled cycles, long enough to fill queues, and shorter free runs."""
    while True:
        yield from repeat(True, random.randint(1, STALL_MAX))
        yield from repeat(False, random.randint(1, BURST_MAX))


def mostly() -> Iterator[bool]:
    return at_random(0.8)


def pause(
    writing,
    reading,
    read: Callable[[], Iterator[bool]],
    write: Callable[[], Iterator[bool]] | None = None,
) -> None:
    """Set pauses on all channels of a model of cocotbext-axi.

    read: pattern of the read channels
    write: pattern of the write channels; default: that of the read channels
    """
    for side, names, pattern in (
        (writing, ("aw", "w", "b"), write or read),
        (reading, ("ar", "r"), read),
    ):
        for name in names:
            getattr(side, f"{name}_channel").set_pause_generator(pattern())


def timed_test(timeout: int, **parameters: Iterable) -> Callable:
    """Decorator of a test: run it with each value of the parameters, for at most `timeout` ns."""
    limited = cocotb.test(timeout_time=timeout, timeout_unit="ns")
    return lambda function: limited(cocotb.parametrize(**parameters)(function))


class Stream:
    """The ports of a stream. name: part before `__payload`: "i", "queue__o", "fork__o__1"."""

    def __init__(self, dut: SimHandleBase, name: str):
        self.name = name
        self.clk, self.rst = dut.clk, dut.rst
        self.payload = getattr(dut, f"{name}__payload")
        self.valid = getattr(dut, f"{name}__valid")
        self.ready = getattr(dut, f"{name}__ready")

    def passes(self) -> bool:
        """True if an item is transferred at this edge."""
        return bool(self.valid.value) and bool(self.ready.value)


async def reset(dut: SimHandleBase, cycles: int = 1) -> None:
    """Hold reset for some cycles. Returns just after the last edge that sees it."""
    dut.rst.value = 1
    await ClockCycles(dut.clk, cycles)
    dut.rst.value = 0


async def send(stream: Stream, payloads: list[int], idle: Iterator[bool] | None = None) -> None:
    """Send payloads in order, with an idle cycle whenever `idle` is true.

    While valid is low the payload is noise, to detect a component that uses it.
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


async def receive(stream: Stream, count: int, stall: Iterator[bool]) -> None:
    """Receive `count` payloads; ready is low in cycles in which `stall` is true."""
    while count:
        stream.ready.value = not next(stall)
        await RisingEdge(stream.clk)
        count -= stream.passes()
    stream.ready.value = 0


class Monitor:
    """Records the payloads transferred on a stream and asserts that offers are kept.

    Start it by `cocotb.start_soon(monitor.watch())`.
    """

    def __init__(self, stream: Stream):
        self.stream = stream
        self.payloads: list[int] = []

    async def watch(self) -> None:
        stream, offered = self.stream, None
        while True:
            await RisingEdge(stream.clk)
            payload = int(stream.payload.value) if stream.valid.value else None
            if offered is not None and not stream.rst.value:
                assert payload is not None, f"{stream.name}: valid fell before ready rose"
                assert payload == offered, f"{stream.name}: payload changed before ready rose"
            if stream.rst.value:
                offered = None
            elif stream.passes():
                self.payloads.append(payload)
                offered = None
            else:
                offered = payload
