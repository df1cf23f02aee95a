"""All clients of `hdl.memory.axi` on memories of `cocotbext-axi` with pauses.

Each writer has its own region of memory; all readers share a region that is never written. Memory
must hold exactly the written data, and read data must come back in the order of requests. With
64-bit addresses there are two windows with memory, and each burst is in a random one.
"""

import random
from collections import deque

import cocotb
import numpy as np
from cocotb.triggers import ClockCycles, RisingEdge
from cocotbext.axi import AxiBus, AxiRam, AxiResp, AxiSlaveRead, AxiSlaveWrite

from splatcore.sim.rtl.cocotb_runner import parameters
from splatcore.spec import axi
from tb.helpers.streams import Stream, pause, start

BURSTS = 40  # bursts of each client in a test
PORT = parameters()["port"]  # bits of the port
BEAT, WIDE = PORT // 8, PORT // axi.DATA_BITS  # bytes per beat; machine words per beat
REGION = 2 * axi.BOUNDARY  # bytes of a client's region; the readers' region is the last one

WINDOW_BITS = parameters()["address_bits"] - axi.ADDRESS_BITS
COUNT = 2 if WINDOW_BITS else 1  # of windows
MEMORY = REGION * (len(axi.WRITERS) + 1)  # bytes in each
READ_BASE = REGION * len(axi.WRITERS)
LENGTH_MAX = 16
HALVES = (axi.PREPROCESSING, axi.RENDERING)
CHANNELS = {"ar": ("id", "addr", "len"), "aw": ("id", "addr", "len"), "w": ("data", "strb", "last")}
FIXED = {"size": BEAT.bit_length() - 1, "burst": 1}
"""Wires of both address channels that are constant while an address is offered."""


class Mixed(AxiSlaveRead):
    """A memory that answers reads of different IDs in random order, beat by beat."""

    async def _process_read(self):
        queues = {k: deque() for k in range(len(axi.READERS))}
        while True:
            while not any(queues.values()) or not self.ar_channel.empty():
                ar = await self.ar_channel.recv()
                address, beats = int(ar.araddr), int(ar.arlen) + 1
                assert address % axi.BOUNDARY + beats * BEAT <= axi.BOUNDARY
                queues[int(ar.arid)] += [(address + n * BEAT, n + 1) for n in range(beats)]
                queues[int(ar.arid)][-1] = (address + (beats - 1) * BEAT, 0)
            client = random.choice([k for k, queue in queues.items() if queue])
            address, more = queues[client].popleft()
            r = self.r_channel._transaction_obj()
            r.rid, r.rlast, r.rresp, r.rdata = client, not more, AxiResp.OKAY, 0
            try:
                r.rdata = int.from_bytes(await self._read(address, BEAT), "little")
            except OSError:
                r.rresp = AxiResp.SLVERR
            await self.r_channel.send(r)


class Memory:
    """Bytes of all windows, one after the other. broken: places of beats answered by an error."""

    def __init__(self, content: np.ndarray, windows: list[int]):
        self.content, self.windows, self.broken = content.copy(), windows, set()

    def place(self, address: int) -> int:
        """Index of an address in `content`."""
        window, below = divmod(address, 1 << axi.ADDRESS_BITS)
        assert window in self.windows, f"no memory at {address:#x}"
        return self.windows.index(window) * MEMORY + below

    async def read(self, address: int, length: int) -> bytes:
        place = self.place(address)
        if place in self.broken:
            raise OSError
        return self.content[place : place + length].tobytes()

    async def write(self, address: int, given: bytes) -> None:
        place = self.place(address)
        if place // BEAT * BEAT in self.broken:
            raise OSError
        self.content[place : place + len(given)] = list(given)


class Bench:
    """Clients, memory, and the expected contents of memory."""

    def __init__(self, dut, kind: str, pattern):
        self.dut, self.pattern = dut, pattern
        rng = np.random.default_rng(random.getrandbits(32))
        self.initial = rng.integers(0, 256, COUNT * MEMORY, np.uint8)
        self.expected = self.initial.copy()
        windows = random.sample(range(1 << WINDOW_BITS), COUNT)
        self.memory, bus = Memory(self.initial, windows), AxiBus.from_prefix(dut, "m_axi_")
        self.offered = {"read": [0] * len(axi.READERS), "write": [0] * len(axi.WRITERS)}  # windows
        if kind == "ram" and COUNT == 1:
            ram = AxiRam(bus, dut.clk, dut.rst, size=MEMORY)
            ram.write(0, self.initial.tobytes())
            self.content = lambda: np.frombuffer(bytes(ram.read(0, MEMORY)), np.uint8)
            writing, reading = ram.write_if, ram.read_if
        else:
            self.content = lambda: self.memory.content
            writing = AxiSlaveWrite(bus.write, dut.clk, dut.rst, target=self.memory)
            slave = AxiSlaveRead if kind == "ram" else Mixed
            reading = slave(bus.read, dut.clk, dut.rst, target=self.memory)
            reading.ar_channel.queue_occupancy_limit = len(axi.READERS)
        pause(writing, reading, pattern)
        self.reads = [Stream(dut, f"reads__{k}") for k in range(len(axi.READERS))]
        self.data = [Stream(dut, f"data__{k}") for k in range(len(axi.READERS))]
        self.writes = [Stream(dut, f"writes__{k}") for k in range(len(axi.WRITERS))]
        # By client: bursts to request, expected read beats, beats to write.
        self.requests = [deque() for _ in axi.READERS]
        self.awaited = [deque() for _ in axi.READERS]
        self.beats = [deque() for _ in axi.WRITERS]
        self.inside = [0 for _ in axi.WRITERS]  # remaining beats of the current burst
        self.silent = [False, False]  # halves whose clients are idle
        self.reading, self.writing = [0, 0], [0 for _ in axi.WRITERS]  # bursts in flight
        self.errors = {"read": set(), "write": set()}
        self.passed = 0  # beats transferred by clients minus beats counted by the module

    async def start(self):
        dut = self.dut
        dut.failing.value = 0
        dut.favoured.value = random.randrange(1 << len(HALVES))
        dut.patient.value = random.getrandbits(len(axi.WRITERS))
        await start(dut, [*self.reads, *self.writes], self.data)
        cocotb.start_soon(self.watch_port())
        cocotb.start_soon(self.watch())
        for k in range(len(axi.READERS)):
            cocotb.start_soon(self.reader(k))
            cocotb.start_soon(self.takes(k))
        for k in range(len(axi.WRITERS)):
            cocotb.start_soon(self.writer(k))

    def load(self, halves=HALVES):
        """Queue random bursts for the clients of some halves."""
        for k, half in enumerate(axi.READERS.values()):
            if half in halves:
                self.requests[k] += [self.burst(READ_BASE) for _ in range(BURSTS)]
        for k, half in enumerate(axi.WRITERS.values()):
            if half in halves:
                for _ in range(BURSTS):
                    first, length = self.burst(k * REGION)
                    for n in range(length):
                        strobe = random.choice([(1 << BEAT) - 1, random.getrandbits(BEAT)])
                        beat = (first, n, length, strobe, random.getrandbits(PORT))
                        self.beats[k].append(beat)

    def burst(self, base: int) -> tuple[int, int]:
        """First port beat and number of beats of a random burst within the boundary."""
        page, beats = axi.BOUNDARY // BEAT, random.choice([1, 2, random.randint(1, LENGTH_MAX)])
        place = random.randint(0, page - beats) + random.randrange(COUNT) * MEMORY // BEAT
        return (base // BEAT + page * random.randrange(REGION // axi.BOUNDARY) + place), beats

    def offer(self, way: str, k: int, first: int | None) -> int:
        """Drive a client's window input to the window of a place, or a random one for None.

        Returns the place within the window.
        """
        window, below = divmod(first or 0, MEMORY // BEAT)
        if WINDOW_BITS:
            any_window = random.getrandbits(WINDOW_BITS)
            self.offered[way][k] = any_window if first is None else self.memory.windows[window]
            numbers = (n << WINDOW_BITS * k for k, n in enumerate(self.offered[way]))
            getattr(self.dut, f"{way}_windows").value = sum(numbers)
        return below

    def fails(self, half: int) -> bool:
        return bool(int(self.dut.failing.value) >> half & 1)

    async def reader(self, k: int):
        """Request bursts."""
        stream, half, idle = self.reads[k], list(axi.READERS.values())[k], self.pattern()
        while True:
            offers = bool(self.requests[k]) and not self.silent[half] and not next(idle)
            stream.valid.value = offers
            self.offer("read", k, None)
            if offers:
                first, beats = self.requests[k][0]
                beat = self.offer("read", k, first) * WIDE
                stream.payload.value = beat | beats - 1 << axi.BEAT_ADDRESS_BITS
            await RisingEdge(self.dut.clk)
            while offers and not stream.ready.value and not self.silent[half]:
                await RisingEdge(self.dut.clk)
            if offers and stream.ready.value:
                assert not self.fails(half), f"reader {k} begins a burst though its half fails"
                self.requests[k].popleft()
                self.reading[half] += 1
                self.awaited[k] += [(first + n, n == beats - 1) for n in range(beats)]

    async def takes(self, k: int):
        """Accept beats and compare them."""
        stream, half, stall = self.data[k], list(axi.READERS.values())[k], self.pattern()
        while True:
            free = not self.silent[half] and not next(stall)
            stream.ready.value = free
            await RisingEdge(self.dut.clk)
            if self.fails(half):
                assert not stream.valid.value, f"reader {k} gets a beat though its half fails"
            if free and stream.valid.value:
                found = int(stream.payload.value)
                beat, last = self.awaited[k].popleft()
                assert found >> PORT == last, f"reader {k}: last"
                address = beat * BEAT
                if address not in self.memory.broken:
                    right = self.initial[address : address + BEAT].tobytes()
                    data = found % (1 << PORT)
                    assert data == int.from_bytes(right, "little"), f"reader {k}: {beat:#x}"
                self.reading[half] -= last
                self.passed += 1

    async def writer(self, k: int):
        """Offer beats, without pauses within a burst."""
        stream, half, idle = self.writes[k], list(axi.WRITERS.values())[k], self.pattern()
        while True:
            offers = bool(self.beats[k]) and not self.silent[half]
            offers = offers and (bool(self.inside[k]) or not next(idle))
            stream.valid.value = offers
            self.offer("write", k, None)
            if offers:
                first, place, length, strobe, data = self.beats[k][0]
                value = first % (MEMORY // BEAT) * WIDE | length - 1 << axi.BEAT_ADDRESS_BITS
                if place == 0:
                    self.offer("write", k, first)
                above = axi.BEAT_ADDRESS_BITS + axi.LENGTH_BITS
                stream.payload.value = value | strobe << above | data << above + BEAT
            await RisingEdge(self.dut.clk)
            while offers and not stream.ready.value and not self.silent[half]:
                await RisingEdge(self.dut.clk)
            if offers and stream.ready.value:
                assert not self.fails(half), f"writer {k} continues though its half fails"
                self.beats[k].popleft()
                self.inside[k] = length - 1 - place
                self.writing[k] += place == 0
                self.passed += 1
                self.put((first + place) * BEAT, strobe, data)

    def put(self, address: int, strobe: int, data: int):
        for byte in range(BEAT):
            if strobe >> byte & 1:
                self.expected[address + byte] = data >> 8 * byte & 255

    async def watch_port(self):
        """Check that offers are kept, and that constant wires are right."""
        dut, offered = self.dut, {}
        wires = {
            channel: [
                getattr(dut, f"m_axi__{channel}{name}") for name in (*names, "valid", "ready")
            ]
            for channel, names in CHANNELS.items()
        }
        while True:
            await RisingEdge(dut.clk)
            for channel, (*parts, valid, ready) in wires.items():
                now = [int(part.value) for part in parts] if valid.value else None
                if now and channel != "w":
                    sent = {name: getattr(dut, f"m_axi__{channel}{name}").value for name in FIXED}
                    assert {name: int(value) for name, value in sent.items()} == FIXED
                if channel in offered:
                    assert now == offered[channel], f"{channel}: the offer changed"
                offered.pop(channel, None)
                if now is not None and not ready.value:
                    offered[channel] = now

    async def watch(self):
        """Track answers, dropped beats and errors; check `idle` and `settled`."""
        dut = self.dut
        halves = list(axi.WRITERS.values())
        while True:
            await RisingEdge(dut.clk)
            idle, settled = int(dut.idle.value), int(dut.settled.value)
            for k, bursts_out in enumerate(self.writing):
                assert not (settled >> k & 1 and bursts_out), f"writer {k} is not settled"
            for half in HALVES:
                in_flight = zip(halves, self.writing, strict=True)
                busy = self.reading[half] or any(n for of, n in in_flight if of == half)
                assert not (idle >> half & 1 and busy), f"half {half} is not idle"
            failing = int(dut.failing.value)
            if dut.m_axi__bvalid.value and dut.m_axi__bready.value:
                self.writing[int(dut.m_axi__bid.value)] -= 1
            passed = int(dut.beats_read.value)
            for k, half in enumerate(axi.READERS.values()):
                if failing >> half & 1 and passed >> k & 1:
                    self.reading[half] -= self.awaited[k].popleft()[1]
                    self.passed += 1
            self.passed -= passed.bit_count() + int(dut.beats_written.value).bit_count()
            for kind, seen in self.errors.items():
                error = int(getattr(dut, f"{kind}_error").value)
                if error & 1:
                    seen.add(error >> 1)

    async def done(self):
        """Wait until all clients are done and the module is idle."""
        while any([*self.requests, *self.beats]):
            await RisingEdge(self.dut.clk)
        while int(self.dut.idle.value) != (1 << len(HALVES)) - 1:
            await RisingEdge(self.dut.clk)
        await ClockCycles(self.dut.clk, 2)
        for k, awaited in enumerate(self.awaited):
            assert not awaited, f"reader {k} lacks beats"

    def abort(self, half: int):
        """Reset the clients of a half."""
        for k, of in enumerate(axi.READERS.values()):
            if of == half:
                assert not self.awaited[k], f"reader {k} lacks beats"
                self.requests[k].clear()
        for k, of in enumerate(axi.WRITERS.values()):
            if of == half:
                self.beats[k].clear()
                self.inside[k] = 0

    def compare(self):
        """Compare memory with the expected contents."""
        found = self.content()
        wrong = np.flatnonzero(found != self.expected)
        wrong = [k for k in wrong if k // BEAT * BEAT not in self.memory.broken]
        assert not wrong, f"{len(wrong)} bytes differ, first {wrong[0]:#x}"
        assert (found != self.initial).any() and self.passed == 0
