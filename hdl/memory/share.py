"""Two readers under one ID of the memory port."""

from amaranth.hdl import Cat, Module, Mux, Signal
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In, Out

from splatcore.hdl.lib.record import stream_of
from splatcore.hdl.memory.axi import read_beat
from splatcore.spec.axi import read_record
from splatcore.spec.config import Config

READERS = 2


class Share(wiring.Component):
    """Shares the port between two readers, burst by burst; the first reader has priority.

    **Timing**: one burst in flight at a time; a request has a latency of one cycle, and two cycles
    pass from the last beat of a burst to the next request. Beats pass at once. No multiplier.
    """

    def __init__(self, config: Config):
        ports = {
            "i": In(stream_of(read_record())).array(READERS),  # the readers' bursts
            "o": Out(stream.Signature(read_beat(config))).array(READERS),  # their beats
            "reads": Out(stream_of(read_record())),  # to the memory port
            "data": In(stream.Signature(read_beat(config))),  # from the memory port
        }
        super().__init__(ports)

    def elaborate(self, platform) -> Module:
        m = Module()
        owner, asked = Signal(READERS), Signal()  # current reader; its burst is in flight
        first, second = self.i
        m.d.comb += [
            self.reads.valid.eq(owner.any() & ~asked),
            self.reads.payload.eq(Mux(owner[0], first.payload, second.payload)),
            self.data.ready.eq((Cat(o.ready for o in self.o) & owner).any()),
        ]
        for own, i, o in zip(owner, self.i, self.o, strict=True):
            m.d.comb += [
                i.ready.eq(own & ~asked & self.reads.ready),
                o.valid.eq(own & self.data.valid),
                o.payload.eq(self.data.payload),
            ]
        with m.If(~owner.any()):
            m.d.sync += owner.eq(Cat(first.valid, second.valid & ~first.valid))
        with m.Elif(self.reads.valid & self.reads.ready):
            m.d.sync += asked.eq(1)
        with m.Elif(self.data.valid & self.data.ready & self.data.payload.last):
            m.d.sync += [owner.eq(0), asked.eq(0)]
        return m
