"""A small device that replaces the machine in tests of its memory and host: it copies memory."""

from functools import cache

import numpy as np
from amaranth.hdl import Module, Mux, Signal
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.stream import Queue
from splatcore.hdl.memory.bus import axi, axi_lite
from splatcore.model.pack.pack import pack
from splatcore.sim.machine.machine import Job
from splatcore.spec.axi import BEAT, BEAT_BITS, DATA_BITS, LITE_ADDRESS_BITS, LITE_DATA_BITS
from splatcore.spec.camera import look_at
from splatcore.spec.config import TINY
from splatcore.spec.packed import PackedModel
from splatcore.spec.registers import CODE_BITS, ErrorCode, addresses
from tb.helpers.scenes import random_scene

FAULTS = ("none", "ar", "aw", "w", "last", "boundary", "size", "outside", "hang", "early")
"""Faults of the device, selected by FEATURES_MAX − `FAULT`."""

FAULT = 1000
BURST = 4  # beats of the device's bursts

DEPTH = 64
POINTS = 50  # cycles of the device's first half
PAGES = 9  # list pages that the device reports in NEEDED

SIZE = (64, 16)  # of its images


@cache
def models() -> list[PackedModel]:
    return [pack(random_scene(500, 1, seed), TINY)[0] for seed in range(2)]


def jobs(count: int = 1) -> list[Job]:
    """Frames of two models in turn."""
    view = look_at(np.array([0.0, 0, -4]), np.zeros(3), *SIZE, 60.0)
    return [Job(models()[k % 2], view) for k in range(count)]


class Copier(wiring.Component):
    """Copies the bytes at MODEL to the image; to the host it looks like a machine."""

    NAMES = ("MODEL", "PIXELS", "STRIDE", "HEIGHT", "LISTS_PAGES", "FEATURES_MAX")

    def __init__(self):
        super().__init__({"s_axi": In(axi_lite()), "m_axi": Out(axi(TINY)), "interrupt": Out(1)})

    def elaborate(self, platform) -> Module:
        m = Module()
        self.registers = {name: Signal(32, name=name.lower()) for name in self.NAMES}
        self.error, self.interrupts, self.enabled = Signal(32), Signal(3), Signal(3)
        self.start, self.ready, self.rendering = Signal(), Signal(init=1), Signal()
        self.source, self.target, self.beats = Signal(32), Signal(32), Signal(16)
        self.events, self.fault, self.finished = Signal(3), Signal(8), Signal(16)
        m.d.sync += self.finished.eq(self.finished + self.events[1])
        m.d.comb += self.fault.eq(self.registers["FEATURES_MAX"] - FAULT)
        m.d.comb += self.interrupt.eq((self.interrupts & self.enabled).any())
        self._lite(m)
        self._first_half(m)
        self._copy(m)
        return m

    def _lite(self, m: Module):
        places = addresses(TINY)
        address, data = Signal(LITE_ADDRESS_BITS), Signal(LITE_DATA_BITS)
        addressed, written, b, r = Signal(), Signal(), self.s_axi.bvalid, self.s_axi.rvalid
        m.d.comb += [self.s_axi.awready.eq(~addressed), self.s_axi.wready.eq(~written)]
        m.d.comb += [self.s_axi.arready.eq(~r | self.s_axi.rready), self.start.eq(0)]
        with m.If(self.s_axi.awvalid & ~addressed):
            m.d.sync += [address.eq(self.s_axi.awaddr), addressed.eq(1)]
        with m.If(self.s_axi.wvalid & ~written):
            m.d.sync += [data.eq(self.s_axi.wdata), written.eq(1)]
        with m.If(b & self.s_axi.bready):
            m.d.sync += b.eq(0)
        m.d.sync += self.interrupts.eq(self.interrupts | self.events)
        with m.If(addressed & written & ~b):
            m.d.sync += [addressed.eq(0), written.eq(0), b.eq(1)]
            with m.Switch(address):
                for name, signal in self.registers.items():
                    with m.Case(places[name]):
                        m.d.sync += signal.eq(data)
                with m.Case(places["INTERRUPT"]):
                    m.d.sync += self.interrupts.eq(self.interrupts & ~data[:3] | self.events)
                with m.Case(places["INTERRUPT_ENABLE"]):
                    m.d.sync += self.enabled.eq(data)
                with m.Case(places["CONTROL"]):
                    m.d.comb += self.start.eq(1)
        read = {"INTERRUPT": self.interrupts, "ERROR": self.error, "STATUS": self.ready}
        read |= {"FINISHED": self.finished, "NEEDED": PAGES, "POINTS_POINTS": self.beats}
        with m.If(self.s_axi.rready):
            m.d.sync += r.eq(0)
        with m.If(self.s_axi.arvalid & self.s_axi.arready):
            m.d.sync += [r.eq(1), self.s_axi.rdata.eq(0)]
            with m.Switch(self.s_axi.araddr):
                for name, value in read.items():
                    with m.Case(places[name]):
                        m.d.sync += self.s_axi.rdata.eq(value)

    def _first_half(self, m: Module):
        left = Signal(range(POINTS + 1))
        with m.If(self.start):
            m.d.sync += [left.eq(POINTS), self.ready.eq(0)]
            with m.If(self.registers["LISTS_PAGES"] < PAGES):
                m.d.sync += self.error.eq(ErrorCode.PAGES)
                m.d.comb += self.events[2].eq(1)
        with m.Elif(left > 1):
            m.d.sync += left.eq(left - 1)
        with m.Elif((left == 1) & ~self.rendering & (self.error == 0)):
            m.d.comb += self.events[0].eq(1)
            m.d.sync += [
                left.eq(0), self.ready.eq(1), self.rendering.eq(1),
                self.source.eq(self.registers["MODEL"]), self.target.eq(self.registers["PIXELS"]),
                self.beats.eq((self.registers["STRIDE"] >> BEAT_BITS) * self.registers["HEIGHT"]),
            ]  # fmt: skip

    def _copy(self, m: Module):
        m.submodules.queue = queue = Queue(DATA_BITS, DEPTH, memory=True)
        asked, promised, given, answered = (Signal(16) for _ in range(4))
        ar, aw, w = self.m_axi.arvalid, self.m_axi.awvalid, self.m_axi.wvalid
        wrong = {name: self.fault == k for k, name in enumerate(FAULTS)}
        flip = Signal(8)
        m.d.sync += flip.eq(flip + 1)
        busy = self.rendering
        m.d.comb += [
            ar.eq(busy & (asked < self.beats) & (asked - given <= DEPTH - BURST)),
            self.m_axi.araddr.eq(
                Mux(wrong["outside"] & (asked == 2 * BURST), 0, self.source + (asked << BEAT_BITS))
                + Mux(wrong["boundary"], 16, 0)
                | Mux(wrong["ar"], flip[2] << 8, 0)
            ),
            self.m_axi.arlen.eq(Mux(wrong["boundary"], 255, BURST - 1)),
            self.m_axi.arsize.eq(BEAT_BITS),
            aw.eq(busy & (promised < self.beats) & ~(wrong["aw"] & flip[2])),
            self.m_axi.awaddr.eq(self.target + (promised << BEAT_BITS)),
            self.m_axi.awlen.eq(BURST - 1),
            self.m_axi.awsize.eq(BEAT_BITS - wrong["size"]),
            w.eq(busy & queue.o.valid),
            self.m_axi.wdata.eq(queue.o.payload ^ Mux(wrong["w"], flip[2], 0)),
            self.m_axi.wstrb.eq((1 << BEAT) - 1),
            self.m_axi.wlast.eq(given[:2] == BURST - 1 - wrong["last"]),
            queue.o.ready.eq(self.m_axi.wready & busy),
            queue.i.valid.eq(self.m_axi.rvalid & ~wrong["hang"]),
            queue.i.payload.eq(self.m_axi.rdata),
            self.m_axi.rready.eq(queue.i.ready & ~wrong["hang"]),
            self.m_axi.bready.eq(1),
        ]
        m.d.comb += [self.m_axi.arburst.eq(1), self.m_axi.awburst.eq(1)]
        for signal, now, step in (
            (asked, ar & self.m_axi.arready, BURST),
            (promised, aw & self.m_axi.awready, BURST),
            (given, w & self.m_axi.wready, 1),
            (answered, self.m_axi.bvalid, BURST),
        ):
            with m.If(now):
                m.d.sync += signal.eq(signal + step)
        for name, now in (
            (ErrorCode.READ, self.m_axi.rvalid & self.m_axi.rready & self.m_axi.rresp[1]),
            (ErrorCode.WRITE, self.m_axi.bvalid & self.m_axi.bresp[1]),
        ):
            with m.If(now & (self.error == 0)):
                m.d.sync += self.error.eq(name | 3 << CODE_BITS)
                m.d.comb += self.events[2].eq(1)
        with m.If(busy & (self.beats == Mux(wrong["early"], given, answered))):
            m.d.sync += [busy.eq(0), *(s.eq(0) for s in (asked, promised, given, answered))]
            m.d.comb += self.events[1].eq(1)
