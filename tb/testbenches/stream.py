"""Testbench of `hdl.lib.stream`: unconnected parts in one simulation.

Parameters, by part
    latency: cycles
    capacity: items that it can hold
    outputs: number of output streams
    level: whether it has a port `level`
    pace: cycles per item without stalls
"""

import random

import cocotb
from cocotb.triggers import ClockCycles, Combine, RisingEdge

from splatcore.sim.rtl.cocotb_runner import parameters
from tb.helpers import streams

PARTS = parameters()["parts"]

FEW = parameters()["few"]  # fewer items and patterns, for a slow simulator

COUNT = 30 if FEW else 40
PATTERNS = [streams.at_random] if FEW else streams.STALLS

TIMEOUT = 50 * COUNT * streams.PERIOD
"""Time limit of each test in ns, which ends a wait for a lost item."""

AFTERMATH = 20  # cycles after the last item, to detect additional items


class Probe:
    """A part with monitors on all its streams."""

    def __init__(self, dut, name: str):
        part = PARTS[name]
        self.dut = dut
        self.latency, self.capacity = part["latency"], part["capacity"]
        self.pace = part["pace"]
        outputs = part["outputs"]
        names = [f"{name}__o"] if outputs == 1 else [f"{name}__o__{k}" for k in range(outputs)]
        self.i = streams.Stream(dut, f"{name}__i")
        self.o = [streams.Stream(dut, name) for name in names]
        self.level = getattr(dut, f"{name}__level") if part["level"] else None

    async def start(self):
        await streams.start(self.dut, [self.i], self.o)
        self.monitor_i = streams.Monitor(self.i)
        self.monitors = [streams.Monitor(o) for o in self.o]
        for monitor in [self.monitor_i, *self.monitors]:
            cocotb.start_soon(monitor.watch())
        if self.level is not None:
            cocotb.start_soon(self.watch_level())

    async def watch_level(self):
        """Check in every cycle that the level is the number of items inside."""
        inside = 0
        while True:
            await RisingEdge(self.dut.clk)
            assert int(self.level.value) == inside
            inside += self.i.passes() - self.o[0].passes()
            if self.dut.rst.value:
                inside = 0

    def cycles(self, first: int) -> list[int]:
        """Cycles of all transfers without stalls. first: of the first transfer."""
        return list(range(first, first + COUNT * self.pace, self.pace))

    def items(self, count: int) -> list[int]:
        return [random.getrandbits(len(self.i.payload)) for _ in range(count)]

    async def pass_on(self, items: list[int], idle, stall):
        """Send items with stalls; every output must have exactly these items, in order."""
        receivers = [cocotb.start_soon(streams.receive(o, len(items), stall())) for o in self.o]
        await Combine(cocotb.start_soon(streams.send(self.i, items, idle())), *receivers)
        await self.aftermath()
        for receiver in receivers:
            assert receiver.result() == items

    async def aftermath(self):
        """Check that no more items come out."""
        passed = [len(monitor.payloads) for monitor in self.monitors]
        for o in self.o:
            o.ready.value = 1
        await ClockCycles(self.dut.clk, AFTERMATH)
        for o in self.o:
            o.ready.value = 0
        await RisingEdge(self.dut.clk)
        assert [len(monitor.payloads) for monitor in self.monitors] == passed


@streams.timed_test(TIMEOUT, part=list(PARTS), idle=PATTERNS, stall=PATTERNS)
async def order(dut, part, idle, stall):
    probe = Probe(dut, part)
    await probe.start()
    await probe.pass_on(probe.items(COUNT), idle, stall)


@streams.timed_test(TIMEOUT, part=list(PARTS))
async def throughput(dut, part):
    """Without stalls an item comes out every `pace` cycles, `latency` cycles after its input."""
    probe = Probe(dut, part)
    await probe.start()
    items = probe.items(COUNT)
    for o in probe.o:
        o.ready.value = 1
    await streams.send(probe.i, items)
    await ClockCycles(dut.clk, probe.latency + 1)
    first = probe.monitor_i.cycles[0]
    assert probe.monitor_i.cycles == probe.cycles(first)
    for monitor in probe.monitors:
        assert monitor.payloads == items
        assert monitor.cycles == probe.cycles(first + probe.latency)


@streams.timed_test(TIMEOUT, part=list(PARTS))
async def capacity(dut, part):
    """With a stalled output exactly `capacity` items fit; afterwards all leave without a gap."""
    probe = Probe(dut, part)
    await probe.start()
    items = probe.items(COUNT)
    cocotb.start_soon(streams.send(probe.i, items))
    stalled = cocotb.start_soon(streams.receive(probe.o[0], 1, streams.always()))
    await ClockCycles(dut.clk, probe.capacity + probe.latency + AFTERMATH)
    assert len(probe.monitor_i.payloads) == probe.capacity
    stalled.cancel()
    for o in probe.o:
        o.ready.value = 1
    await ClockCycles(dut.clk, COUNT * probe.pace + 1)
    for monitor in probe.monitors:
        assert monitor.payloads == items
        assert monitor.cycles == probe.cycles(monitor.cycles[0])


@streams.timed_test(TIMEOUT, part=list(PARTS))
async def reset_empties(dut, part):
    """After a reset at any time no earlier item comes out."""
    probe = Probe(dut, part)
    await probe.start()
    for before in range(2 if FEW else 12):
        works = [streams.send(probe.i, probe.items(COUNT), streams.at_random(0.3))]
        works += [streams.receive(o, COUNT, streams.at_random(0.7)) for o in probe.o]
        tasks = [cocotb.start_soon(work) for work in works]
        await ClockCycles(dut.clk, 1 + before)
        for task in tasks:
            task.cancel()
        await streams.reset(dut)
        await probe.pass_on(probe.items(2), streams.never, streams.never)


@streams.timed_test(TIMEOUT, part=[name for name, part in PARTS.items() if part["outputs"] > 1])
async def outputs_do_not_wait(dut, part):
    """Each output gets an item once, even while another output is stalled."""
    probe = Probe(dut, part)
    await probe.start()
    items = probe.items(2)
    cocotb.start_soon(streams.send(probe.i, items))
    for k, o in enumerate(probe.o):
        o.ready.value = 1
        await ClockCycles(dut.clk, 5)
        last = k == len(probe.o) - 1
        assert probe.monitors[k].payloads == (items if last else items[:1])
